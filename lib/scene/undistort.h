// SPDX-License-Identifier: Apache-2.0
// The one place where lens distortion is removed from images: everything behind it sees pinhole cameras.
#pragma once

#include <string>

#include "lib/scene/camera_models.h"
#include "lib/scene/scene.h"

namespace gs {

/// Intrinsics and size of the pinhole image that a distorted one becomes: same focal lengths, the largest size without blank
/// pixels along the borders (COLMAP's rule with blank_pixels = 0, 0.2 to 2 times the size per axis); pose left at identity.
/// Pinhole lenses come back unchanged. Throws DataError, starting with `where`, for equirectangular cameras and lenses too
/// wide for a pinhole.
Camera undistorted_camera(const LensCamera& lens, const std::string& where);

/// Resamples an image of `lens` to `pinhole` (bilinear on pixel centres, alpha premultiplied meanwhile; the mask follows the
/// same map). Pixels whose ray misses the source get mask 0; the result has a mask if the input has one or such pixels exist.
ViewImage undistort(const ViewImage& in, const LensCamera& lens, const Camera& pinhole);

}  // namespace gs
