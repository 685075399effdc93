// SPDX-License-Identifier: Apache-2.0
// Finds the files that may hold a scene's points, and chooses among them.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/source_scene.h"

namespace gs {

/// A file with points: a PLY, or points3D.bin or points3D.txt of COLMAP.
struct PointFile {
    std::filesystem::path path;
    std::optional<SourcePoints> points = {};  ///< its points, if already read
};

/// Returns whether a point file is read as a PLY instead of as COLMAP's points3D.
bool is_ply(const std::filesystem::path& path);

/// Returns the files of `folder` that have one of these names, in upper or lower case, in the order of the names.
std::vector<PointFile> point_files(const std::filesystem::path& folder, const std::vector<std::string>& names);

/// Sets scene.points to the points of the first file that holds any. Adds the chosen file to scene.facts, unless it is
/// COLMAP's own, and the unused files to scene.notes; `rule` gives the reason for the order in words. A points3D.ply
/// with as many points as COLMAP's file beside it is assumed to be the copy that 3DGS makes: COLMAP's file, which is
/// more exact, is used instead. Throws DataError if a file is damaged, unless an earlier file has points.
void choose_points(std::vector<PointFile> files, const std::string& rule, SourceScene& scene);

/// Reads the points of a PLY with x,y,z of any type. Colours are red,green,blue (also diffuse_red, ... and r,g,b), or
/// f_dc of a model of Gaussians; their range (1, 255 or 65535) follows from type and largest value. Points without
/// colour become grey and non-finite points are left out, both with a note. Throws DataError.
SourcePoints read_point_ply(const std::filesystem::path& path, std::vector<std::string>& notes);

}  // namespace gs
