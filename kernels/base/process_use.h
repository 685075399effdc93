// SPDX-License-Identifier: Apache-2.0
// What this process uses of the machine.
#pragma once

#include <cstdint>

namespace gs {

/// Returns the bytes of memory that this process occupies now, or 0 where the system does not say.
std::int64_t resident_bytes();

/// Returns the seconds that the threads of this process have computed, since its beginning. Waiting does not count.
double cpu_seconds();

}  // namespace gs
