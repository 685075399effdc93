// SPDX-License-Identifier: Apache-2.0
// Writes COLMAP models in text form.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "lib/scene/source_scene.h"

namespace gs {

/// An image with its lens, in the photograph's own pixels, and its pose in scene units.
struct PosedImage {
    std::string name;
    LensCamera lens;
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< rotation of cam_from_world
    Eigen::Vector3d translation = Eigen::Vector3d::Zero();
};

/// Writes cameras.txt, images.txt and points3D.txt to `folder`, without observations of the points. Images with equal
/// lenses share a camera. Throws DataError.
void write_colmap_model(const std::filesystem::path& folder, const std::vector<PosedImage>& images,
                        const SourcePoints& points);

}  // namespace gs
