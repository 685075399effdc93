// SPDX-License-Identifier: Apache-2.0
// Backends of one rank.
#pragma once

#include "kernels/ranks/backend.h"

namespace gs {

inline std::unique_ptr<Backend> make_cpu_backend(const AppearanceSpec& appearance, const EngineOptions& options = {}) {
    return std::make_unique<Backend>(make_cpu_engine(appearance, options));
}

inline std::unique_ptr<Backend> make_cuda_backend(const AppearanceSpec& appearance, const EngineOptions& options = {}) {
    return std::make_unique<Backend>(make_cuda_engine(appearance, options));
}

}  // namespace gs

namespace gs::test {

/// A backend over an engine that a test has made up, for as long as the test looks at that.
template <class E> class BackendOf : public Backend {
  public:
    template <class... Arguments>
    requires std::is_constructible_v<E, Arguments...>
    explicit BackendOf(Arguments&&... arguments)
        : BackendOf(Owned{std::make_unique<E>(std::forward<Arguments>(arguments)...)}) {}
    E* operator->() { return &engine_; }
    E& engine() { return engine_; }

  private:
    struct Owned {
        std::unique_ptr<E> engine;
    };
    explicit BackendOf(Owned&& owned) : BackendOf(*owned.engine, owned) {}
    BackendOf(E& engine, Owned& owned) : Backend(std::move(owned.engine)), engine_(engine) {}

    E& engine_;
};

}  // namespace gs::test
