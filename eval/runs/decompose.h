// SPDX-License-Identifier: Apache-2.0
// A picture and its parts: what every direction sees, and how far view dependence moves it.
#pragma once

#include <array>

#include "kernels/backend.h"

namespace gs {

struct PicturePart {
    RenderMode mode;
    const char* name;  ///< of its folder
};
inline constexpr std::array<PicturePart, 3> kPictureParts = {
    {{RenderMode::kFull, "full"}, {RenderMode::kBaseOnly, "base"}, {RenderMode::kResidualOnly, "residual"}}};

/// The render of one part. Full and base stand before `background`. The residual, each Gaussian's |c - phi(c0)| blended
/// with the weights of the full picture, is a difference and stands before black: the background has no part in it. So
/// it bounds |full - base| in every pixel and channel, and equals it where all Gaussians of the pixel move the same way (before a
/// photometric correction, which full and base get and the residual does not).
RenderRequest part_request(const CameraParams<float>& camera, const Vec3<float>& background, RenderMode mode, const IspView& isp = {});

/// Mean over pixels and channels of the picture as rendered, neither clamped nor rounded; 0 for an empty one. Of a residual:
/// how much of the picture depends on the view, in units of the full colour range.
double mean_value(const RenderedImage& image);

}  // namespace gs
