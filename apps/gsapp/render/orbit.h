// SPDX-License-Identifier: Apache-2.0
// Cameras on a circle around the scene.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// A distance in scene units, or as a multiple of the default distance.
struct OrbitRadius {
    double value = 1;
    bool is_factor = true;
};

/// Parses "2.5" (scene units) or "1.5x" (a multiple). Throws UsageError for any other text and for values that are not
/// above 0.
OrbitRadius parse_orbit_radius(const std::string& text);

/// Parses "X,Y,Z". Throws UsageError for any other text.
Eigen::Vector3d parse_orbit_target(const std::string& text);

/// Parses "x", "y", "z", "-x", "-y" or "-z". Throws UsageError for any other text.
Eigen::Vector3d parse_axis(const std::string& text);

/// Settings of an orbit; the training cameras determine the rest.
struct OrbitShape {
    int count = 0;                               ///< number of cameras
    OrbitRadius radius = {};                     ///< distance of the cameras from the target
    std::optional<double> elevation = {};        ///< height of the cameras above the target, degrees within +-89
    std::optional<Eigen::Vector3d> target = {};  ///< point that the cameras look at, scene coordinates
    std::optional<Eigen::Vector3d> up = {};      ///< up direction, of length 1
};

/// Returns a default view of a model without cameras, in the model's frame: 1280x720 pixels, 50 degrees high, from
/// above the centre of the Gaussians, in front of the model, and at a distance that shows most of them. Unless
/// `shape` has them, its target becomes that centre, and its up direction -y.
View usual_view(const Gaussians& model, OrbitShape& shape, const Frame& frame);

/// Returns cameras on a circle, in the frame, with the first view's intrinsics. Unless the shape sets other values,
/// they look at the common target of the cameras of `views`, from their mean distance and height, with their mean up
/// direction. Throws UsageError without views and for count < 1.
std::vector<Camera> orbit_path(const std::vector<View>& views, const OrbitShape& shape, const Frame& frame);

}  // namespace gs
