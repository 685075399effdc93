// SPDX-License-Identifier: Apache-2.0
// The files that a scene's points may come from, and the choice among them.
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
    std::optional<SourcePoints> points = {};  ///< its points, if they were read already
};

/// Returns whether a file with points is read as a PLY, not as COLMAP's.
bool is_ply(const std::filesystem::path& path);

/// Returns the files of `folder` that have one of these names, in upper or lower case, in the order of the names.
std::vector<PointFile> point_files(const std::filesystem::path& folder, const std::vector<std::string>& names);

/// Sets scene.points to those of the first file that holds any. scene.facts says which file that is, unless it is
/// COLMAP's own, and scene.notes which of the others are not used; `rule` says in words why the first goes first. A
/// points3D.ply with as many points as COLMAP's file beside it is taken for the copy that 3DGS makes: COLMAP's file is
/// used, which is more exact. Throws DataError if a file is damaged, unless one before it has points.
void choose_points(std::vector<PointFile> files, const std::string& rule, SourceScene& scene);

/// Reads the points of a PLY with x,y,z of any type. Colours are red,green,blue (also diffuse_red, ... and r,g,b), or
/// f_dc of a model of Gaussians; their range (1, 255 or 65535) follows from type and largest value. Points without
/// colour are grey; non-finite points are left out. Notes say so. Throws DataError.
SourcePoints read_point_ply(const std::filesystem::path& path, std::vector<std::string>& notes);

}  // namespace gs
