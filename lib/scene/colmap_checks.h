// SPDX-License-Identifier: Apache-2.0
// Checks that the readers of binary and text COLMAP files share.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>
#include <unordered_set>

#include "lib/scene/colmap_reader.h"

namespace gs::colmap {

/// Adds cameras, images and points to a model and checks each. Counts the skipped ones and notes them in `finish`.
class ModelBuilder {
  public:
    explicit ModelBuilder(ColmapModel& model) : model_(model) {}

    void add_camera(const std::filesystem::path& file, std::uint32_t id, CameraModel model, std::uint64_t width,
                    std::uint64_t height, std::span<const double> params);
    /// `pose` is qw qx qy qz tx ty tz of cam_from_world.
    void add_image(const std::filesystem::path& file, std::uint32_t id, const std::array<double, 7>& pose,
                   std::uint32_t camera_id, std::string name);
    void add_point(const std::filesystem::path& file, std::uint64_t id, const Eigen::Vector3d& position,
                   const std::array<int, 3>& rgb);
    void note(const std::string& line) { model_.notes.push_back(line); }
    void finish();

  private:
    ColmapModel& model_;
    std::unordered_set<std::uint32_t> image_ids_;
    std::unordered_set<std::uint64_t> point_ids_;
    std::size_t skipped_images_ = 0, skipped_points_ = 0;
    std::string first_skipped_image_;
};

/// Reads cameras.bin, images.bin and, if present, points3D.bin. Throws DataError.
void read_binary(const std::filesystem::path& folder, ModelBuilder& builder);
/// Reads cameras.txt, images.txt and, if present, points3D.txt. Throws DataError.
void read_text(const std::filesystem::path& folder, ModelBuilder& builder);

}  // namespace gs::colmap
