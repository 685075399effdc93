// SPDX-License-Identifier: Apache-2.0
// Turns a source image with its lens into a view: a camera at the training size and a function that loads the pixels.
// Lens distortion is removed only here, if at all.
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

/// Returns the camera of the views of a lens, without a pose: the lens itself, or undistorted_camera(). With
/// LensMode::kAuto it is the lens itself if there is no undistorted image. Throws DataError, starting with `where`, if
/// the lens cannot be used.
Camera choose_camera(const LensCamera& lens, LensMode mode, const std::string& where);

/// Returns the weights of a lens's pixels in the loss (1 channel, 8 bit): 255, 0 where the lens sees nothing, and for a
/// 360-degree image the share of solid angle, at least 1. Null if all are 255.
std::shared_ptr<const Image> lens_weights(const Camera& lens);

/// Resamples an image of `lens` to `pinhole`, from the same place, bilinearly on pixel centres with premultiplied
/// alpha. The cameras' poses are not used: `lens_from_pinhole` rotates directions from the pinhole's frame to the
/// lens's. The mask is resampled in the same way. Pixels whose ray misses the source, or is beyond the range of the
/// lens, get mask 0. The result has a mask if the input has one or if such pixels exist.
ViewImage undistort(const ViewImage& in, const Camera& lens, const Camera& pinhole,
                    const Eigen::Matrix3d& lens_from_pinhole = Eigen::Matrix3d::Identity());

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
    /// Returns lens_weights() of a view's lens, computed once for views of one lens.
    std::shared_ptr<const Image> weights_of(const Camera& lens);

    SceneOptions options_;
    int prescaled_;
    std::size_t undistorted_ = 0, native_ = 0, partly_seen_ = 0, resized_ = 0, capped_ = 0, kept_small_ = 0;
    std::string undistorted_model_, native_model_, resized_example_;
    double least_seen_ = 1;  ///< smallest share of a photograph's pixels that is used
    Camera last_lens_;       ///< lens of weights_; most scenes have one lens
    std::shared_ptr<const Image> weights_;
    bool has_alpha_ = false;
};

}  // namespace gs
