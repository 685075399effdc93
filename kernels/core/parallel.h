// SPDX-License-Identifier: Apache-2.0
// The one place that picks threads on the CPU.
#pragma once

#include <cstdint>
#include <functional>

namespace gs {

/// 0 = all cores the process may use. Not while a parallel_for runs.
void set_num_threads(int threads);
int num_threads();

/// Calls fn(i) for i in [0, n), in any order and on any thread; waits for all. Results must not depend on the order;
/// callers that reduce do so over fixed-size parts, in order. The first exception is rethrown. Idle threads sleep, so
/// that a busy machine does not slow it beyond its share. Cost: some microseconds, and an indirect call for each i.
void parallel_for_function(std::int64_t n, const std::function<void(std::int64_t)>& fn);

/// The same for any callable, passed by reference: std::function would copy a large closure to the heap.
template <class Fn> void parallel_for(std::int64_t n, Fn&& fn) { parallel_for_function(n, std::ref(fn)); }

/// Ascending; the same for any number of threads, as keys are plain numbers.
void parallel_sort(std::uint64_t* begin, std::uint64_t* end);

/// Rows of the Gaussian arrays are worked on in parts of this size, whatever the number of threads.
inline constexpr std::int64_t kPartSize = 1024;
inline std::int64_t num_parts(std::int64_t n, std::int64_t part = kPartSize) { return (n + part - 1) / part; }

/// parallel_for over rows in parts of kPartSize: for work too small for a call each.
template <class Fn> void parallel_for_rows(std::int64_t n, Fn&& fn) {
    parallel_for(num_parts(n), [&](std::int64_t part) {
        for (std::int64_t i = part * kPartSize, end = i + kPartSize < n ? i + kPartSize : n; i < end; ++i) fn(i);
    });
}

}  // namespace gs
