// SPDX-License-Identifier: Apache-2.0
// Computes the cameras' common target and the frame of a scene: the similarity that brings its coordinates to the size
// and position for which near plane, noise, regularisers and 32-bit floats are designed
// (docs/math/optimization.md#frame).
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Returns the point nearest to all optical axes in the least-squares sense, in the units of the cameras. A small pull
/// towards the cameras' mean position determines the point if all cameras look in one direction and the axes never
/// meet.
Eigen::Vector3d common_target(const std::vector<View>& views);

/// Returns the mean of the cameras' unit axes. Its length is 1 if all cameras look in the same direction, and 0 without
/// views.
Eigen::Vector3d mean_axis(const std::vector<View>& views);

/// Chooses the frame of a scene from its camera centres and points, both in scene units; either may be empty. The size
/// of a scene is 1.1 times the 90th percentile of the cameras' distances from their middle, but at least a fiftieth of
/// the points' median distance from that middle. Scenes within a factor of 1.25 of size 4.75, which is typical of
/// COLMAP and NeRF-synthetic, keep their scale; others are scaled to 4.75. The centre stays at the origin unless the
/// cameras are more than 16 sizes away from it. A scene without points whose cameras are all in one place has no size
/// and keeps its scale.
Frame choose_frame(const std::vector<Eigen::Vector3d>& camera_centers, const std::vector<Eigen::Vector3d>& points);

/// Converts a camera from scene coordinates to frame coordinates, and back.
Camera into_frame(Camera camera, const Frame& frame);
Camera out_of_frame(Camera camera, const Frame& frame);

/// Returns the offset of files with 32-bit coordinates: they hold scene coordinates minus this offset. It is the
/// frame's centre if the spacing of floats there would be 2.4e-4 frame units or more, and otherwise zero.
Eigen::Vector3d file_offset(const Frame& frame);

/// Converts between frame coordinates and a file's coordinates, which are scene coordinates minus an offset. An
/// identity frame leaves every bit unchanged.
struct FileCoordinates {
    Frame frame;
    Eigen::Vector3d offset = Eigen::Vector3d::Zero();

    // Both functions subtract, because adding a zero offset would turn -0 into 0.
    double to_file(double x, int axis) const { return x / frame.scale - (offset[axis] - frame.center[axis]); }
    double from_file(double x, int axis) const { return frame.scale * (x - (frame.center[axis] - offset[axis])); }
    /// Convert logarithms of sizes.
    double size_to_file(double log_size) const { return log_size - std::log(frame.scale); }
    double size_from_file(double log_size) const { return log_size - std::log(1 / frame.scale); }
};

/// Returns the PLY comment that states such an offset: kOffsetComment, the three numbers, and how to apply them.
std::string offset_comment(const Eigen::Vector3d& offset);
inline constexpr const char* kOffsetComment = "gsapp offset ";

/// Returns "center X Y Z scale S" with the shortest numbers that read back exactly. Files store this text.
std::string frame_text(const Frame& frame);
/// Parses the text of `frame_text`. Returns nothing if the text has another form or its numbers are not a valid frame.
std::optional<Frame> parse_frame(const std::string& text);

/// Returns the frame as {"center": [x, y, z], "scale": s}, the form used in results and exports.
nlohmann::ordered_json frame_json(const Frame& frame);

}  // namespace gs
