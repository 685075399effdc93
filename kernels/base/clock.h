// SPDX-License-Identifier: Apache-2.0
// Clocks, and this process's use of memory and processor time.
#pragma once

#include <chrono>
#include <cstdint>

namespace gs {

/// Returns the seconds since some fixed moment. The clock is steady: setting the machine's time does not move it.
inline double seconds_now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Returns the bytes of memory that this process occupies now, or 0 if the system does not report it.
std::int64_t resident_bytes();

/// Returns the CPU time in seconds of all threads of this process since its start. Waiting does not count.
double cpu_seconds();

}  // namespace gs
