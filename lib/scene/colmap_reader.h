// SPDX-License-Identifier: Apache-2.0
// Reads COLMAP models (binary and text) into plain structs and checks all their values.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "lib/scene/camera_models.h"
#include "lib/scene/source_scene.h"

namespace gs {

/// A point that an image sees.
struct ColmapObservation {
    float x = 0, y = 0;       ///< pixels
    std::uint64_t point = 0;  ///< point3D_id
};

struct ColmapImage {
    std::uint32_t id = 0, camera_id = 0;
    std::string name;                                        ///< relative to the image folder
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< rotation of cam_from_world
    Eigen::Vector3d translation = Eigen::Vector3d::Zero();   ///< translation of cam_from_world
    std::vector<ColmapObservation> observations;             ///< of points of the model, or of others
};

struct ColmapModel {
    std::filesystem::path folder;
    std::map<std::uint32_t, LensCamera> cameras;
    std::vector<ColmapImage> images;  ///< every camera_id is in `cameras`
    SourcePoints points;
    std::unordered_map<std::uint64_t, std::size_t> rows;  ///< row in `points` by point3D_id
    std::vector<std::string> notes;                       ///< one line per kind of skipped data
};

/// Returns the observations of an image that are of the model's points, at most kMostObservations of them, with points
/// in scene units.
std::vector<PointObservation> observations(const ColmapModel& model, const ColmapImage& image);

/// Finds the model folder inside a scene: the sub-folder of `sparse` with the most images (reported in `notes` if there
/// are several), else `sparse`, else the scene folder itself. Returns an empty path if none of these folders holds
/// cameras and images. Throws nothing.
std::filesystem::path find_colmap_model(const std::filesystem::path& scene, std::vector<std::string>& notes);

/// Returns whether the folder holds cameras.bin and images.bin, which are then read instead of the text files. Throws
/// DataError if the file system cannot be queried.
bool is_binary_colmap_model(const std::filesystem::path& folder);

/// Returns the file of COLMAP's points in a folder: points3D.bin or points3D.txt. If both exist, returns the one in the
/// format (binary or text) of the folder's model; if neither exists, an empty path.
std::filesystem::path colmap_point_file(const std::filesystem::path& folder);

/// Reads a points3D.bin or points3D.txt. Notes and errors are as in `read_colmap_model`.
SourcePoints read_colmap_points(const std::filesystem::path& file, std::vector<std::string>& notes);

/// Reads cameras, images and points3D from `folder`: the binary files if both cameras.bin and images.bin exist, else
/// the text files. If the chosen format has no points file, reads points in the other format. Skips and notes
/// non-finite poses, non-finite points and trailing bytes. A missing points3D file means no points. Throws DataError
/// naming file, field and value for truncated files, counts that the file size does not allow (checked before
/// allocating), unknown camera models, invalid intrinsics, duplicate ids and images without a camera. Memory use is at
/// most a small multiple of the file sizes.
ColmapModel read_colmap_model(const std::filesystem::path& folder);

}  // namespace gs
