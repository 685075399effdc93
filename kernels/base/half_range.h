// SPDX-License-Identifier: Apache-2.0
// The range of half precision, for the host and for CUDA, which has its own half type.
#pragma once

namespace gs {

inline constexpr double kLargestHalf = 65504;

}  // namespace gs
