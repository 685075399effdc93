// SPDX-License-Identifier: Apache-2.0
// Clocks, and what this process uses of the machine.
#pragma once

#include <chrono>
#include <cstdint>

namespace gs {

/// Returns the seconds since some fixed moment. The clock is steady: setting the machine's time does not move it.
inline double seconds_now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Returns the bytes of memory that this process occupies now, or 0 if the system does not say.
std::int64_t resident_bytes();

/// Returns the seconds that the threads of this process have computed, since its beginning. Waiting does not count.
double cpu_seconds();

}  // namespace gs
