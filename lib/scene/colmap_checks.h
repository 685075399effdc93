// SPDX-License-Identifier: Apache-2.0
// Checks shared by the readers of binary and text COLMAP files.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>
#include <unordered_map>
#include <unordered_set>

#include "lib/scene/colmap_reader.h"

namespace gs::colmap {

/// Adds cameras, images and points to a model and checks each. Counts the skipped items and adds notes about them in
/// `finish`.
class ModelBuilder {
  public:
    explicit ModelBuilder(ColmapModel& model) : model_(model) {}

    void add_camera(const std::filesystem::path& file, std::uint32_t id, CameraModel model, std::uint64_t width,
                    std::uint64_t height, std::span<const double> params);
    /// Records why the camera `id` cannot be used. Its images are left out; an unusable camera without images is
    /// ignored. Throws DataError, starting with the file, if the id appears twice.
    void add_unusable_camera(const std::filesystem::path& file, std::uint32_t id, std::string reason);
    /// `pose` is qw qx qy qz tx ty tz of cam_from_world.
    void add_image(const std::filesystem::path& file, std::uint32_t id, const std::array<double, 7>& pose,
                   std::uint32_t camera_id, std::string name, std::vector<ColmapObservation> observations);
    /// `rgb` is in 0..255.
    void add_point(const std::filesystem::path& file, std::uint64_t id, const Eigen::Vector3d& position,
                   const Eigen::Vector3d& rgb);
    /// Interprets the colours of all points as values in [0,1] instead of 0..255.
    void set_unit_colors();
    void note(const std::string& line) { model_.notes.push_back(line); }
    /// Adds the notes. Throws DataError with the first reason if images were left out and none remains.
    void finish();

  private:
    void require_new_camera(const std::filesystem::path& file, std::uint32_t id) const;

    ColmapModel& model_;
    std::unordered_map<std::uint32_t, std::string> unusable_cameras_;  ///< reason by camera id
    std::string first_unusable_camera_;
    std::unordered_set<std::uint32_t> image_ids_;
    std::unordered_set<std::uint64_t> skipped_point_ids_;
    std::size_t skipped_images_ = 0, without_camera_ = 0;
    std::string first_skipped_image_, first_without_camera_;
};

/// Reads cameras.bin and images.bin. Throws DataError.
void read_binary(const std::filesystem::path& folder, ModelBuilder& builder);
/// Reads cameras.txt and images.txt. Throws DataError.
void read_text(const std::filesystem::path& folder, ModelBuilder& builder);
/// Reads a points3D.bin or points3D.txt, depending on the extension. Throws DataError.
void read_points(const std::filesystem::path& file, ModelBuilder& builder);
/// Reads a points3D.bin. Throws DataError.
void read_binary_points(const std::filesystem::path& file, ModelBuilder& builder);
/// Reads a points3D.txt. Throws DataError.
void read_text_points(const std::filesystem::path& file, ModelBuilder& builder);
/// Returns the number of records in an images.txt, well-formed or not. Throws DataError if it cannot be read.
std::uint64_t count_text_images(const std::filesystem::path& file);

}  // namespace gs::colmap
