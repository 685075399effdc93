// SPDX-License-Identifier: Apache-2.0
// Ranks as threads of one process, connected through Gloo like processes.
#pragma once

#include <condition_variable>
#include <map>
#include <mutex>
#include <thread>

#include "kernels/ranks/gloo_communicator.h"
#include "kernels/ranks/ranked_backend.h"

namespace gs::test {

/// A meeting place in memory.
class TableOfValues final : public MeetingPlace {
  public:
    void set(const std::string& key, const std::vector<char>& value) override {
        const std::lock_guard lock(mutex_);
        values_[key] = value;
        changed_.notify_all();
    }
    std::vector<char> get(const std::string& key) override {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return values_.contains(key); });
        return values_[key];
    }

  private:
    std::mutex mutex_;
    std::condition_variable changed_;
    std::map<std::string, std::vector<char>> values_;
};

/// Calls run(communicator) on `size` ranks at once; a single one needs no connection. Exceptions of rank 0 are
/// rethrown, when the other ranks have ended.
template <class Fn> void on_ranks(int size, Fn&& run) {
    if (size == 1) {
        SingleRank one;
        return run(one);
    }
    TableOfValues place;
    std::exception_ptr error;
    std::vector<std::thread> threads;
    for (int rank = 0; rank < size; ++rank)
        threads.emplace_back([&, rank] {
            try {
                const auto ranks = connect_with_gloo(place, rank, size, "127.0.0.1");
                run(*ranks);
            } catch (...) {
                if (rank == 0) error = std::current_exception();
            }
        });
    for (std::thread& thread : threads) thread.join();
    if (error) std::rethrow_exception(error);
}

/// Calls use(backend) with a model that `size` ranks hold, each on a backend of its own.
template <class Fn, class Make>
void with_ranked_backend(int size, int views_per_step, const TargetSource& targets, Fn&& use, Make&& make) {
    on_ranks(size, [&](Communicator& ranks) {
        std::unique_ptr<Backend> own = make();
        if (ranks.rank() > 0) return follow(ranks, *own, targets);
        RankedBackend backend(ranks, std::move(own), views_per_step);
        use(backend);
    });
}

/// The same on the CPU.
template <class Fn>
void with_ranked_backend(int size, int views_per_step, const AppearanceSpec& appearance, const TargetSource& targets,
                         Fn&& use) {
    with_ranked_backend(size, views_per_step, targets, use, [&] { return make_cpu_backend(appearance); });
}

}  // namespace gs::test
