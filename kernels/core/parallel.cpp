// SPDX-License-Identifier: Apache-2.0
// Parallel loops on a TBB arena of the chosen number of threads.
#include "kernels/core/parallel.h"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <memory>

namespace gs {
namespace {

/// The threads of all parallel work. The control lets the arena have more threads than cores, which tests ask for.
struct Threads {
    tbb::task_arena arena;
    std::unique_ptr<tbb::global_control> control;

    Threads() { set(0); }
    void set(int threads) {
        if (threads <= 0) threads = tbb::info::default_concurrency();
        if (control && threads == arena.max_concurrency()) return;  // another thread may be at work in it
        arena.terminate();
        control =
            std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
        arena.initialize(threads);
    }
};

Threads& threads() {
    static Threads instance;
    return instance;
}

}  // namespace

void set_num_threads(int count) { threads().set(count); }
int num_threads() { return threads().arena.max_concurrency(); }

void parallel_for_function(std::int64_t n, const std::function<void(std::int64_t)>& fn) {
    if (n == 1) return fn(0);
    threads().arena.execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<std::int64_t>(0, n, 1),
            [&](const tbb::blocked_range<std::int64_t>& r) {
                for (std::int64_t i = r.begin(); i < r.end(); ++i) fn(i);
            },
            tbb::simple_partitioner());
    });
}

}  // namespace gs
