// SPDX-License-Identifier: Apache-2.0
// Where cameras look, and the frame of a scene: the similarity that brings its coordinates to the size and place for
// which near plane, noise, regularisers and 32-bit floats are made (docs/math/optimization.md#frame).
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
/// towards the cameras' mean decides where all look in one direction and the axes never meet.
Eigen::Vector3d common_target(const std::vector<View>& views);

/// Returns the mean of the cameras' unit axes. Its length is 1 if all look the same way, and 0 without a view.
Eigen::Vector3d mean_axis(const std::vector<View>& views);

/// Chooses the frame of a scene from its camera centres and points, both in scene units; either may be empty. The size
/// of a scene is 1.1 times the distance from the cameras' middle that nine tenths of them do not exceed, but at least a
/// fiftieth of the median distance of the points from it. Scenes within a factor of 1.25 of size 4.75, which is what
/// COLMAP and NeRF-synthetic give, keep their scale; others are scaled to 4.75. The centre stays the origin unless the
/// cameras are more than 16 sizes away from it. Cameras in one place without points have no size and keep their scale.
Frame choose_frame(const std::vector<Eigen::Vector3d>& camera_centers, const std::vector<Eigen::Vector3d>& points);

/// Returns the camera of scene coordinates in those of the frame, and the other way round.
Camera into_frame(Camera camera, const Frame& frame);
Camera out_of_frame(Camera camera, const Frame& frame);

/// Returns what files with 32-bit coordinates leave out: they hold scene coordinates minus this offset. It is the
/// frame's centre where a float's steps would be more than 2.4e-4 frame units, and otherwise zero.
Eigen::Vector3d file_offset(const Frame& frame);

/// The conversion between the coordinates of a frame and those of a file, which are the scene's minus an offset. A
/// frame without scale and centre leaves every bit as it is.
struct FileCoordinates {
    Frame frame;
    Eigen::Vector3d offset = Eigen::Vector3d::Zero();

    // Differences, because a sum would turn -0 into 0 if nothing is to change.
    double to_file(double x, int axis) const { return x / frame.scale - (offset[axis] - frame.center[axis]); }
    double from_file(double x, int axis) const { return frame.scale * (x - (frame.center[axis] - offset[axis])); }
    /// These take and return logarithms of sizes.
    double size_to_file(double log_size) const { return log_size - std::log(frame.scale); }
    double size_from_file(double log_size) const { return log_size - std::log(1 / frame.scale); }
};

/// Returns the comment by which a PLY states such an offset: kOffsetComment, the numbers, and what to do with them.
std::string offset_comment(const Eigen::Vector3d& offset);
inline constexpr const char* kOffsetComment = "gsapp offset ";

/// Returns "center X Y Z scale S" with the shortest numbers that are read back exactly; files hold it.
std::string frame_text(const Frame& frame);
/// Returns the frame of such a text; nothing if it is another, or its numbers are no frame.
std::optional<Frame> parse_frame(const std::string& text);

/// Returns the frame as {"center": [x, y, z], "scale": s}, as results and exports state it.
nlohmann::ordered_json frame_json(const Frame& frame);

}  // namespace gs
