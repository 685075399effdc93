// SPDX-License-Identifier: Apache-2.0
// Cameras on a circle around the scene.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// A distance in scene units, or as a multiple of the usual one.
struct OrbitRadius {
    double value = 1;
    bool is_factor = true;
};

/// Reads "2.5" (scene units) or "1.5x" (a multiple). Throws UsageError for any other text and for values that are not
/// above 0.
OrbitRadius parse_orbit_radius(const std::string& text);

/// Reads "X,Y,Z". Throws UsageError for any other text.
Eigen::Vector3d parse_orbit_target(const std::string& text);

/// Reads "x", "y", "z", "-x", "-y" or "-z". Throws UsageError for any other text.
Eigen::Vector3d parse_axis(const std::string& text);

/// What is asked of an orbit; the training cameras decide the rest.
struct OrbitShape {
    int count = 0;                               ///< number of cameras
    OrbitRadius radius = {};                     ///< distance of the cameras from the target
    std::optional<double> elevation = {};        ///< height of the cameras above the target, degrees within +-89
    std::optional<Eigen::Vector3d> target = {};  ///< the point they look at, scene coordinates
    std::optional<Eigen::Vector3d> up = {};      ///< the direction of "up", of length 1
};

/// Returns a view of a model that no cameras belong to, in its frame: 1280x720 pixels, 50 degrees high, above the
/// middle of the Gaussians, in front of the model, and so far away that most are seen. Sets the target of `shape` to
/// that middle, and its "up" to -y, if they are not given.
View usual_view(const Gaussians& model, OrbitShape& shape, const Frame& frame);

/// Returns cameras on a circle, in the frame, with the first view's intrinsics. They look at the point that the cameras
/// of `views` look at, from their mean distance and height, if the shape does not say otherwise. "Up" is the
/// cameras' mean upward direction. Throws UsageError without views and for count < 1.
std::vector<Camera> orbit_path(const std::vector<View>& views, const OrbitShape& shape, const Frame& frame);

}  // namespace gs
