// SPDX-License-Identifier: Apache-2.0
// The range of half precision, for the host and for CUDA, whose own type for halves differs.
#pragma once

namespace gs {

inline constexpr double kLargestHalf = 65504;

}  // namespace gs
