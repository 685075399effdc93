// SPDX-License-Identifier: Apache-2.0
// Removes lens distortion from images. This is the one place that does: everything after it sees pinhole cameras.
#pragma once

#include <string>

#include "lib/scene/camera_models.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns intrinsics and size of the undistorted image; the pose is left at identity. Focal lengths stay the same. The
/// size is the largest without blank pixels along the borders (COLMAP's rule with blank_pixels = 0, 0.2 to 2 times the
/// size per axis). Pinhole lenses come back unchanged. Throws DataError, starting with `where`, for equirectangular
/// cameras, lenses too wide for a pinhole and damaged parameters.
Camera undistorted_camera(const LensCamera& lens, const std::string& where);

/// Resamples an image of `lens` to `pinhole`, bilinearly on pixel centres with premultiplied alpha. The mask follows
/// the same map. Pixels whose ray misses the source get mask 0; the result has a mask if the input has one or such
/// pixels exist.
ViewImage undistort(const ViewImage& in, const LensCamera& lens, const Camera& pinhole);

}  // namespace gs
