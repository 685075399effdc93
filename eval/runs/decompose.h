// SPDX-License-Identifier: Apache-2.0
// The parts of a picture: what every direction sees, and how far view dependence moves it.
#pragma once

#include <array>

#include "kernels/ranks/backend.h"

namespace gs {

/// A render mode and the folder of its pictures.
struct PicturePart {
    RenderMode mode;
    const char* name;  ///< name of the folder
};
inline constexpr std::array<PicturePart, 3> kPictureParts = {
    {{RenderMode::kFull, "full"}, {RenderMode::kBaseOnly, "base"}, {RenderMode::kResidualOnly, "residual"}}};

/// Returns the request that renders one part. Full and base stand before `background`. The residual blends each
/// Gaussian's |c - phi(c0)| with the weights of the full picture. It is a difference and stands before black, so that
/// it bounds |full - base| in every pixel and channel, and equals it where all Gaussians of the pixel move the same
/// way. Both hold before the photometric correction `isp`, which full and base get and the residual does not.
RenderRequest part_request(const CameraParams<float>& camera, const Vec3<float>& background, RenderMode mode,
                           const IspView& isp = {});

/// Returns the mean over pixels and channels of the picture as rendered, neither clamped nor rounded; 0 for an empty
/// one. The mean of a residual says how much of the picture depends on the view, in units of the full colour range.
double mean_value(const RenderedImage& image);

}  // namespace gs
