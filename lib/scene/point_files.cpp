// SPDX-License-Identifier: Apache-2.0
// Finds the files that may hold a scene's points, and chooses among them.
#include "lib/scene/point_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "kernels/base/error.h"
#include "kernels/base/spherical_harmonics.h"
#include "lib/core/input_file.h"
#include "lib/io/ply_file.h"
#include "lib/scene/colmap_reader.h"
#include "lib/scene/image_files.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

SourcePoints read_file(PointFile& file, std::vector<std::string>& notes) {
    if (file.points) return std::move(*file.points);
    return is_ply(file.path) ? read_point_ply(file.path, notes) : read_colmap_points(file.path, notes);
}

/// Returns the number of points in a file. Throws DataError.
std::size_t count_points(const PointFile& file) {
    std::vector<std::string> ignored;
    if (file.points) return file.points->positions.size();
    return is_ply(file.path) ? std::size_t(PlyReader(file.path).header().count)
                             : read_colmap_points(file.path, ignored).positions.size();
}

/// Moves COLMAP's file in front of a points3D.ply that is a copy of it. Returns whether there is such a copy.
bool prefer_original(std::vector<PointFile>& files) {
    if (files.size() < 2 || !is_ply(files[0].path) || is_ply(files[1].path)) return false;
    if (files[0].path.parent_path() != files[1].path.parent_path()) return false;
    const std::size_t count = count_points(files[0]);
    if (count == 0 || count != count_points(files[1])) return false;
    std::swap(files[0], files[1]);
    return true;
}

/// The colour columns of a PLY.
struct ColorColumns {
    std::array<int, 3> column = {-1, -1, -1};
    bool is_base_color = false;  ///< colours are the constant band of spherical harmonics, as in models of Gaussians

    bool found() const { return column[0] >= 0 && column[1] >= 0 && column[2] >= 0; }
};

ColorColumns find_colors(const PlyReader& reader) {
    static constexpr std::array<const char*, 3> kNames[] = {{"red", "green", "blue"},
                                                            {"diffuse_red", "diffuse_green", "diffuse_blue"},
                                                            {"r", "g", "b"},
                                                            {"f_dc_0", "f_dc_1", "f_dc_2"}};
    for (const auto& names : kNames) {
        const ColorColumns columns{{reader.find(names[0]), reader.find(names[1]), reader.find(names[2])},
                                   names[0] == std::string_view("f_dc_0")};
        if (columns.found()) return columns;
    }
    return {};
}

/// Returns the value that represents 1 in colours of this type whose largest value is `largest`. Many writers store
/// 8-bit values in wider types.
float color_range(PlyType type, float largest) {
    const bool real = type == PlyType::kFloat || type == PlyType::kDouble;
    // Floating-point colours may slightly exceed 1. If they hold 8-bit values, one of them is above 2 unless all are
    // black.
    if (real && largest <= 2) return 1;
    return largest <= 255 || type == PlyType::kInt8 ? 255.0f : 65535.0f;
}

}  // namespace

bool is_ply(const fs::path& path) { return path.extension() != ".bin" && path.extension() != ".txt"; }

std::vector<PointFile> point_files(const fs::path& folder, const std::vector<std::string>& names) {
    std::vector<PointFile> files;
    for (const std::string& name : names)
        for (const fs::path& path : entries_named(folder, name))
            if (names_file(path)) files.push_back({path});
    return files;
}

void choose_points(std::vector<PointFile> files, const std::string& rule, SourceScene& scene) {
    const bool has_copy = prefer_original(files);
    std::size_t chosen = 0;
    for (; chosen < files.size() && scene.points.positions.empty(); ++chosen) {
        scene.points = read_file(files[chosen], scene.notes);
        if (scene.points.positions.empty() && is_ply(files[chosen].path))
            scene.notes.push_back(fmt::format("{}: it holds no points", files[chosen].path.string()));
    }
    if (scene.points.positions.empty()) return;
    const std::string used =
        fmt::format("points: {} of {}", scene.points.positions.size(), files[chosen - 1].path.string());
    if (has_copy)
        scene.facts.push_back(fmt::format("{}; {} has as many and is taken for a copy", used, files[1].path.string()));
    else if (is_ply(files[chosen - 1].path))
        scene.facts.push_back(used);
    std::vector<std::string> unused;
    for (std::size_t i = std::max<std::size_t>(chosen, has_copy ? 2 : 0); i < files.size(); ++i) {
        try {
            if (const std::size_t count = count_points(files[i]))
                unused.push_back(fmt::format("{} ({} points)", files[i].path.string(), count));
        } catch (const DataError& error) {
            unused.push_back(error.what());
        }
    }
    if (!unused.empty())
        scene.notes.push_back(fmt::format("{}; not used: {}; {}; remove or rename a file to use another", used,
                                          fmt::join(unused, ", "), rule));
}

SourcePoints read_point_ply(const fs::path& path, std::vector<std::string>& notes) {
    PlyReader reader(path);
    if (reader.find("packed_position") >= 0)
        reader.fail("it is a compressed model of Gaussians, which has no points; save it as an ordinary PLY");
    const int axes[3] = {reader.require("x"), reader.require("y"), reader.require("z")};
    const ColorColumns colors = find_colors(reader);
    SourcePoints points;
    std::size_t not_finite = 0;
    float largest = 0;
    while (const std::int64_t rows = reader.next_chunk())
        for (std::int64_t r = 0; r < rows; ++r) {
            const Eigen::Vector3d p(reader.value(r, axes[0]), reader.value(r, axes[1]), reader.value(r, axes[2]));
            if (!p.cast<float>().allFinite()) {
                ++not_finite;
                continue;
            }
            Eigen::Vector3f rgb = Eigen::Vector3f::Zero();
            for (int c = 0; colors.found() && c < 3; ++c) rgb[c] = float(reader.value(r, colors.column[c]));
            if (rgb.allFinite()) largest = std::max(largest, rgb.maxCoeff());
            points.positions.push_back(p);
            points.colors.push_back(rgb);
        }
    const PlyType type =
        colors.found() ? reader.header().properties[std::size_t(colors.column[0])].type : PlyType::kUint8;
    const float range = color_range(type, largest);
    for (Eigen::Vector3f& rgb : points.colors) {
        if (!colors.found() || !rgb.allFinite()) {
            rgb.setConstant(0.5f);
            continue;
        }
        for (float& value : rgb) {
            if (colors.is_base_color)
                value = 0.5f + float(kY0) * value;
            else
                // A colour above 127 in a signed byte reads as a negative number.
                value = (type == PlyType::kInt8 && value < 0 ? value + 256 : value) / range;
            value = std::clamp(value, 0.0f, 1.0f);
        }
    }
    if (not_finite > 0)
        notes.push_back(fmt::format("{}: {} of {} points are not finite: skipped", path.string(), not_finite,
                                    reader.header().count));
    if (!colors.found() && !points.positions.empty())
        notes.push_back(fmt::format("{}: its points have no colours: grey", path.string()));
    if (reader.find("f_dc_0") >= 0)
        notes.push_back(
            fmt::format("{}: it is a model of Gaussians, of which only the {} means and base colours are "
                        "taken; --init takes the whole model",
                        path.string(), points.positions.size()));
    return points;
}

}  // namespace gs
