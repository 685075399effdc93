// SPDX-License-Identifier: Apache-2.0
// Which of a pixel's Gaussians says how deep it is.
#pragma once

namespace gs {

/// A depth of a pixel: the mean of its Gaussians' by the weights of their colours, or that of the one at which
/// transmittance falls to 1/2 or below.
enum class DepthKind { kExpected, kMedian };

inline constexpr DepthKind kDepthKinds[] = {DepthKind::kExpected, DepthKind::kMedian};

/// Returns the name of the folder with such depths.
constexpr const char* depth_folder(DepthKind kind) { return kind == DepthKind::kMedian ? "median_depth" : "depth"; }

}  // namespace gs
