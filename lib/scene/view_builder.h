// SPDX-License-Identifier: Apache-2.0
// Turns a source image with its lens into a view: a pinhole camera at the training size and a function that loads the
// pixels. Lens distortion is removed only here: all later code handles pinhole cameras.
#pragma once

#include <string>

#include "lib/scene/camera_models.h"
#include "lib/scene/scene.h"
#include "lib/scene/source_scene.h"

namespace gs {

/// Returns the camera (intrinsics and size) of the undistorted image; its pose is the identity. Focal lengths stay the
/// same. The size is the largest without blank pixels along the borders (COLMAP's rule with blank_pixels = 0, 0.2 to 2
/// times the size per axis). Pinhole lenses come back unchanged. Throws DataError, starting with `where`, for
/// equirectangular cameras, lenses too wide for a pinhole and damaged parameters.
Camera undistorted_camera(const LensCamera& lens, const std::string& where);

/// Resamples an image of `lens` to `pinhole`, bilinearly on pixel centres with premultiplied alpha. The mask is
/// resampled in the same way. Pixels whose ray misses the source get mask 0. The result has a mask if the input has one
/// or if such pixels exist.
ViewImage undistort(const ViewImage& in, const LensCamera& lens, const Camera& pinhole);

/// Builds views one by one and counts the undistorted and the resized ones.
class ViewBuilder {
  public:
    /// `prescaled` is the divisor by which the image folder is already scaled; above 1, options.resolution is not
    /// applied again.
    ViewBuilder(const SceneOptions& options, int prescaled) : options_(options), prescaled_(prescaled) {}

    /// Builds one view.
    View build(const SourceView& source);

    /// Returns one line about undistortion, and one about each kind of size that the options did not request.
    std::vector<std::string> notes() const;
    /// Returns a line about images that were resized as requested by the options, if there are any.
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
