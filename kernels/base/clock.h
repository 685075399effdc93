// SPDX-License-Identifier: Apache-2.0
// The clock that measures durations.
#pragma once

#include <chrono>

namespace gs {

/// Returns the seconds since some fixed moment. The clock is steady: setting the machine's time does not move it.
inline double seconds_now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace gs
