// SPDX-License-Identifier: Apache-2.0
// Turns a source image with its lens into a view: a pinhole camera at the training size and a function that loads the
// pixels. This is the one place that removes lens distortion: everything after it sees pinhole cameras.
#pragma once

#include <string>

#include "lib/scene/camera_models.h"
#include "lib/scene/scene.h"
#include "lib/scene/source_scene.h"

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

/// Builds views one after the other and counts which of them it undistorted or resized.
class ViewBuilder {
  public:
    /// `prescaled` is the divisor by which the image folder is already scaled; above 1, options.resolution is not
    /// applied again.
    ViewBuilder(const SceneOptions& options, int prescaled) : options_(options), prescaled_(prescaled) {}

    /// Builds one view.
    View build(const SourceView& source);

    /// Returns one line each about undistortion, and about sizes that the options did not ask for.
    std::vector<std::string> notes() const;
    /// Returns a line about images that were resized as the options ask, if there are any.
    std::vector<std::string> facts() const;
    bool has_alpha() const { return has_alpha_; }

  private:
    std::pair<int, int> training_size(int width, int height);

    SceneOptions options_;
    int prescaled_;
    std::size_t undistorted_ = 0, resized_ = 0, capped_ = 0, kept_small_ = 0;
    std::string undistorted_model_, resized_example_;
    bool has_alpha_ = false;
};

}  // namespace gs
