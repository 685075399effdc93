// SPDX-License-Identifier: Apache-2.0
// The one place that picks threads on the CPU.
#pragma once

#include <omp.h>

#include <cstdint>
#include <exception>

namespace gs {

/// 0 = all cores the process may use.
inline void set_num_threads(int threads) { omp_set_num_threads(threads > 0 ? threads : omp_get_num_procs()); }

/// Calls fn(i) for i in [0, n), in any order and on any thread. Results must not depend on the order; callers that
/// reduce do so over fixed-size parts, in order. The first exception is rethrown on the calling thread.
template <class Fn> void parallel_for(std::int64_t n, Fn&& fn) {
    std::exception_ptr error;
#pragma omp parallel for schedule(dynamic, 1) if (n > 1)
    for (std::int64_t i = 0; i < n; ++i) {
        try {
            fn(i);
        } catch (...) {
#pragma omp critical(gs_parallel_for_error)
            if (!error) error = std::current_exception();
        }
    }
    if (error) std::rethrow_exception(error);
}

/// Rows of the Gaussian arrays are worked on in parts of this size, whatever the number of threads.
inline constexpr std::int64_t kPartSize = 1024;
inline std::int64_t num_parts(std::int64_t n, std::int64_t part = kPartSize) { return (n + part - 1) / part; }

/// Index of the calling worker, for scratch memory: [0, max_workers()).
inline int worker_index() { return omp_get_thread_num(); }
inline int max_workers() { return omp_get_max_threads(); }

}  // namespace gs
