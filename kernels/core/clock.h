// SPDX-License-Identifier: Apache-2.0
// The clock that durations are measured with.
#pragma once

#include <chrono>

namespace gs {

/// Seconds since an arbitrary start, on a clock that never goes back: for differences only.
inline double seconds_now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace gs
