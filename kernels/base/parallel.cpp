// SPDX-License-Identifier: Apache-2.0
// Parallel loops in a TBB arena of the chosen number of threads.
#include "kernels/base/parallel.h"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "kernels/base/error.h"

namespace gs {
namespace {

/// Throws DeviceError unless the system can start that many more threads. TBB starts its own threads inside noexcept
/// functions, so a failure there would end the program.
void require_threads(int count) {
    std::mutex mutex;
    std::condition_variable changed;
    bool done = false;
    std::vector<std::thread> started;
    std::string reason;
    try {
        started.reserve(std::size_t(count));
        while (started.size() < std::size_t(count)) {
            started.emplace_back([&] {
                std::unique_lock lock(mutex);
                changed.wait(lock, [&] { return done; });
            });
        }
    } catch (const std::exception& e) {
        reason = e.what();
    }
    {
        const std::lock_guard lock(mutex);
        done = true;
    }
    changed.notify_all();
    for (std::thread& thread : started) thread.join();
    if (!reason.empty())
        throw DeviceError("the system gives " + std::to_string(started.size() + 1) + " of " +
                          std::to_string(count + 1) + " threads: " + reason +
                          ". Use fewer with --threads, or raise the limit of processes (ulimit -u) or of memory "
                          "(ulimit -v)");
}

/// The threads of all parallel work. The control allows more threads than cores in the arena, as tests request.
struct Threads {
    tbb::task_arena arena;
    std::unique_ptr<tbb::global_control> control;

    explicit Threads(int threads) { set(threads); }
    void set(int threads) {
        if (threads <= 0) threads = tbb::info::default_concurrency();
        if (control && threads == arena.max_concurrency()) return;  // another thread may be working in it
        require_threads(threads - 1);
        arena.terminate();
        control =
            std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism, std::size_t(threads));
        arena.initialize(threads);
    }
};

/// Returns the threads. `first` is the number of threads on the first call.
Threads& threads(int first = 0) {
    static Threads instance(first);
    return instance;
}

}  // namespace

void set_num_threads(int count) { threads(count).set(count); }
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
