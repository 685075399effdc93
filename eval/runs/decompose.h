// SPDX-License-Identifier: Apache-2.0
// The parts of an image: the base, which is the same from every direction, and the view-dependent residual.
#pragma once

#include <array>

#include "kernels/ranks/backend.h"

namespace gs {

/// A render mode and the folder of its images.
struct PicturePart {
    RenderMode mode;
    const char* name;  ///< name of the folder
};
inline constexpr std::array<PicturePart, 3> kPictureParts = {
    {{RenderMode::kFull, "full"}, {RenderMode::kBaseOnly, "base"}, {RenderMode::kResidualOnly, "residual"}}};

/// Returns the request that renders one part. The full image and the base are rendered over `background`. The residual
/// blends each Gaussian's |c - phi(c0)| with the weights of the full image. It is a difference and is rendered over
/// black, so that it bounds |full - base| in every pixel and channel, and equals it if all Gaussians of the pixel
/// change in the same direction. Both properties hold before the photometric correction `isp`, which is applied to full
/// and base but not to the residual.
RenderRequest part_request(const CameraParams<float>& camera, const Vec3<float>& background, RenderMode mode,
                           const IspView& isp = {});

/// Returns the mean over pixels and channels of the image as rendered, neither clamped nor rounded; 0 for an empty
/// image. The mean of a residual measures how much of the image depends on the view, in units of the full colour range.
double mean_value(const RenderedImage& image);

}  // namespace gs
