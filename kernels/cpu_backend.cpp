// SPDX-License-Identifier: Apache-2.0
// Picks the CPU backend of a model from the generated list.
#include <utility>

#include "appearance/model_info.h"
#include "kernels/backend.h"
#include "kernels/core/error.h"

#include "cpu_backends.inc"

namespace gs {

std::unique_ptr<Backend> make_cpu_backend(const AppearanceSpec& appearance) {
    const ModelInfo& info = appearance_model(appearance.model); // throws for an unknown name
    for (const auto& [name, make] : kCpuBackends)
        if (info.name == name) return make();
    throw UsageError("appearance model '" + appearance.model + "' has no CPU backend");
}

}  // namespace gs
