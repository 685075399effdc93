// SPDX-License-Identifier: Apache-2.0
// The lens models of COLMAP: their names, their parameters and their projection in both directions, in double.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <string_view>

#include "kernels/splat/lens_device.h"

namespace gs {

struct CameraModelInfo {
    CameraModel id;
    std::string_view name;
    int num_focal;       ///< 1: f,cx,cy; 2: fx,fy,cx,cy; 0: equirectangular, with only w,h
    int num_distortion;  ///< number of parameters after the principal point
    int num_params() const { return num_focal == 0 ? 2 : num_focal + 2 + num_distortion; }
};

/// Returns all models; entry i has id i.
std::span<const CameraModelInfo> camera_models();
/// Returns whether the model distorts the plane of a pinhole image by a polynomial. Such a lens sees less than a half
/// space.
bool is_plane_polynomial(CameraModel model);
/// Returns the name and parameter counts of one model.
const CameraModelInfo& camera_model_info(CameraModel model);

/// A camera with lens distortion. Lengths are in pixels; pixel (0,0) has its centre at (0.5,0.5). Models with one focal
/// length have fx = fy here, so that width and height can be scaled separately. For the equirectangular model fx and fy
/// are the full width and height.
struct LensCamera {
    CameraModel model = CameraModel::kPinhole;
    int width = 0, height = 0;
    double fx = 0, fy = 0, cx = 0, cy = 0;
    std::array<double, 12> distortion{};  ///< coefficients in COLMAP's order; unused entries are 0

    bool operator==(const LensCamera&) const = default;
};

/// Makes a camera from `params` in COLMAP's order, camera_model_info(model).num_params() of them. Does not check the
/// values.
LensCamera make_lens_camera(CameraModel model, int width, int height, std::span<const double> params);

/// Returns the lens for an image of another size. Focal lengths and principal point scale per axis; distortion is
/// unchanged.
LensCamera scaled_to(const LensCamera& lens, int width, int height);

/// Returns true if the lens maps straight lines to straight lines, so that no undistortion is needed.
bool is_pinhole(const LensCamera& lens);

/// The part of a lens that is used: the largest circle around the axis on which it is one to one, and on which a radian
/// away from the axis takes at least 0.4 focal lengths of the image, as far as the image reaches.
struct LensRange {
    double max_angle = 0;  ///< largest angle to the axis, radians
    double slope = 0;      ///< growth of the normalised image coordinates there, per radian
    bool folds = false;    ///< whether the image reaches beyond, where the distortion squeezes it or folds it back
};

/// Finds the range of a lens from its projection along 32 half planes through the axis, to 1e-6 radians. max_angle is 0
/// if the lens folds at its axis.
LensRange lens_range(const LensCamera& lens);

/// Returns the kernels' lens. A pinhole's range is not used.
template <class T> Lens<T> kernel_lens(const LensCamera& lens, const LensRange& range) {
    Lens<T> out{};
    if (is_pinhole(lens)) return out;
    out.model = lens.model;
    for (int k = 0; k < 12; ++k) out.distortion[k] = T(lens.distortion[k]);
    if (lens.model == CameraModel::kFov) {
        out.distortion[0] = T(std::abs(lens.distortion[0]));
        out.distortion[1] = T(2 * std::tan(0.5 * std::abs(lens.distortion[0])));
    }
    out.max_angle = T(range.max_angle), out.slope = T(range.slope);
    out.sin_max = T(std::sin(range.max_angle)), out.cos_max = T(std::cos(range.max_angle));
    // Gaussians beyond the image reach into it by their extent. A cone of 0.3 rad holds most of them.
    out.cos_drawn = T(std::cos(std::min(range.max_angle + 0.3, 3.1)));
    return out;
}

/// Returns the pixel onto which a point in camera space (OpenCV axes) projects. Returns nothing if the point is outside
/// the model's domain, behind the camera (for models that distort the plane of a pinhole), or in the range where the
/// distortion folds over (non-positive Jacobian), which is not part of a real image.
std::optional<Eigen::Vector2d> project(const LensCamera& lens, const Eigen::Vector3d& point);

/// Returns the direction in camera space through a pixel, of unit length. Returns nothing if no ray belongs to the
/// pixel, or if Newton's method does not converge.
std::optional<Eigen::Vector3d> unproject(const LensCamera& lens, const Eigen::Vector2d& pixel);

}  // namespace gs
