// SPDX-License-Identifier: Apache-2.0
// The memory of this process.
#pragma once

#include <cstdint>

namespace gs {

/// Returns the bytes of memory that this process occupies now, or 0 where the system does not say.
std::int64_t resident_bytes();

}  // namespace gs
