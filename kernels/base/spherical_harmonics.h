// SPDX-License-Identifier: Apache-2.0
// The spherical harmonic of band 0.
#pragma once

namespace gs {

/// 1/(2 sqrt(pi)), the same in every direction. 3DGS stores colours as coefficients of it; here it is folded into the
/// base colour.
inline constexpr double kY0 = 0.28209479177387814;

}  // namespace gs
