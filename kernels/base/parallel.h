// SPDX-License-Identifier: Apache-2.0
// Parallel loops on the CPU. Only this file manages threads.
#pragma once

#include <cstdint>
#include <functional>

namespace gs {

/// Sets the number of threads; 0 means all cores that the process may use. Must not be called while a parallel_for
/// runs. Throws DeviceError if the system cannot start that many.
void set_num_threads(int threads);
int num_threads();

/// Calls fn(i) for i in [0, n), in any order and on any thread, and waits for all. Results must not depend on the
/// order; callers that reduce do so over fixed-size parts, in order. The first exception is rethrown. Idle threads
/// sleep, so that a busy machine does not slow the loop beyond its share. A loop costs some microseconds, and an
/// indirect call for each i.
void parallel_for_function(std::int64_t n, const std::function<void(std::int64_t)>& fn);

/// Calls parallel_for_function with any callable by reference; std::function would copy a large closure to the heap.
template <class Fn> void parallel_for(std::int64_t n, Fn&& fn) { parallel_for_function(n, std::ref(fn)); }

/// Number of Gaussian rows per part of parallel work, for any number of threads.
inline constexpr std::int64_t kPartSize = 1024;
inline std::int64_t num_parts(std::int64_t n, std::int64_t part = kPartSize) { return (n + part - 1) / part; }

/// Calls fn(i) for rows i in [0, n), in parallel parts of kPartSize. For work that is too small for one call per row.
template <class Fn> void parallel_for_rows(std::int64_t n, Fn&& fn) {
    parallel_for(num_parts(n), [&](std::int64_t part) {
        for (std::int64_t i = part * kPartSize, end = i + kPartSize < n ? i + kPartSize : n; i < end; ++i) fn(i);
    });
}

}  // namespace gs
