// SPDX-License-Identifier: Apache-2.0
// The lens models of COLMAP: their names, their parameters and their projection in both directions, in double.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>
#include <string_view>

namespace gs {

/// The lens models of COLMAP, numbered as in cameras.bin.
enum class CameraModel : int {
    kSimplePinhole = 0,
    kPinhole = 1,
    kSimpleRadial = 2,
    kRadial = 3,
    kOpenCV = 4,
    kOpenCVFisheye = 5,
    kFullOpenCV = 6,
    kFov = 7,
    kSimpleRadialFisheye = 8,
    kRadialFisheye = 9,
    kThinPrismFisheye = 10,
    kRadTanThinPrismFisheye = 11,
    kSimpleDivision = 12,
    kDivision = 13,
    kSimpleFisheye = 14,
    kFisheye = 15,
    kEucm = 16,
    kEquirectangular = 17,
};

struct CameraModelInfo {
    CameraModel id;
    std::string_view name;
    int num_focal;       ///< 1: f,cx,cy; 2: fx,fy,cx,cy; 0: equirectangular, with only w,h
    int num_distortion;  ///< number of parameters after the principal point
    int num_params() const { return num_focal == 0 ? 2 : num_focal + 2 + num_distortion; }
};

/// Returns all models; entry i has id i.
std::span<const CameraModelInfo> camera_models();
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

/// Returns the pixel onto which a point in camera space (OpenCV axes) projects. Returns nothing if the point is behind
/// the camera (except for equirectangular), outside the model's domain, or in the range where the distortion folds over
/// (non-positive Jacobian), which is not part of a real image.
std::optional<Eigen::Vector2d> project(const LensCamera& lens, const Eigen::Vector3d& point);

/// Returns the direction in camera space through a pixel: z = 1, or unit length for the equirectangular model. Returns
/// nothing if no ray in front of the camera belongs to the pixel, or if Newton's method does not converge.
std::optional<Eigen::Vector3d> unproject(const LensCamera& lens, const Eigen::Vector2d& pixel);

}  // namespace gs
