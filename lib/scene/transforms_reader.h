// SPDX-License-Identifier: Apache-2.0
// Reads transforms*.json of NeRF-synthetic, instant-ngp and nerfstudio into plain structs.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/camera_models.h"

namespace gs {

/// Intrinsics as stated in the file. Lengths are in pixels of a w x h image, angles in radians. resolve_intrinsics
/// derives the absent ones from the image size.
struct TransformsIntrinsics {
    std::optional<int> width, height;
    std::optional<double> focal_x, focal_y, angle_x, angle_y, cx, cy;
    CameraModel model = CameraModel::kPinhole;
    std::array<double, 12> distortion{};
};

struct TransformsFrame {
    std::string file_path;  ///< path as in the file, but with '/' and without leading "./"
    std::string mask_path;  ///< path in the same form; empty if absent
    bool is_bad = false;
    TransformsIntrinsics intrinsics;
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< rotation of cam_from_world, OpenCV axes
    Eigen::Vector3d translation = Eigen::Vector3d::Zero();
};

struct TransformsFile {
    std::filesystem::path path;
    std::vector<TransformsFrame> frames;       ///< frames in the order of the file
    std::vector<TransformsFrame> test_frames;  ///< frames of the key test_frames (ScanNet++)
    /// The explicit split of nerfstudio, with names as in file_path; empty without the key.
    std::optional<std::vector<std::string>> train_filenames, val_filenames, test_filenames;
    std::string point_file;  ///< ply_file_path; empty if absent
    std::vector<std::string> notes;
};

/// Parses a file (comments allowed). Per-frame keys override top-level ones. The focal length comes from the first of
/// these that is present: frame lengths, frame angles, file lengths, file angles. Camera axes are converted from OpenGL
/// to OpenCV. World coordinates are unchanged: applied_transform and instant-ngp's scale and offset concern other
/// coordinate frames and are ignored. Throws DataError naming file, frame, key and value for missing keys, wrong types,
/// unsupported lenses and matrices that are not rigid transforms.
TransformsFile read_transforms(const std::filesystem::path& path);

/// Returns the lens of a frame at its nominal size: w, h from the file, or else the size of the image. Throws
/// DataError, starting with `where`, if the file gives no focal length.
LensCamera resolve_intrinsics(const TransformsIntrinsics& intrinsics, int image_width, int image_height,
                              const std::string& where);

}  // namespace gs
