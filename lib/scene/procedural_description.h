// SPDX-License-Identifier: Apache-2.0
// What a procedural scene's YAML file says: the world, the cameras, and how single photographs break the static world.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/procedural_caster.h"

namespace gs::procedural {

/// Cameras on a spherical cap around `look_at`, all looking at it, world z up in the picture.
struct CameraRig {
    int width = 160, height = 120;                  ///< pixels
    double fov = 45;                                ///< horizontal field of view, degrees
    double radius = 4;                              ///< distance to look_at, world units
    double elevation_min = 15, elevation_max = 60;  ///< degrees above the horizon
    Eigen::Vector3d look_at{0, 0, 0};
    int train = 40, test = 8;  ///< how many
};

/// The shape `shape` stands `offset` away from its place in every `every`-th training view.
struct MovedShape {
    std::string shape;
    Eigen::Vector3d offset{0, 0, 0};
    int every = 2;
};

/// Every view, training and test, is taken with settings of its own: each is drawn uniformly and depends on (seed, set, index)
/// alone. One device takes all of them.
struct ExposureJitter {
    double stops = 0.5;       ///< exposure: factor 2^e, e in (-stops, stops)
    double white_balance = 0; ///< channels: factors 2^g, g in (-white_balance, white_balance) less their mean
    double vignetting = 0;    ///< light lost in the corner of the image, 0..1; falls with the square of the distance to the centre
    std::uint64_t seed = 0;
};

/// With which settings a view was taken.
struct Photography {
    double stops = 0;                         ///< exposure
    Eigen::Vector3d gain = Eigen::Vector3d::Ones(); ///< white balance; their product is 1
};

/// In every `every`-th training view an unseen sphere blocks the light; it passes from `from` to `to` over the views.
struct PassingShadow {
    Eigen::Vector3d from{0, 0, 0}, to{0, 0, 0};
    double radius = 0.5;
    int every = 2;
};

struct Description {
    World world;
    CameraRig cameras;
    int pixel_grid = 2;  ///< rays per pixel and axis
    int points = 5000;   ///< initial points
    std::optional<MovedShape> moved;
    std::optional<ExposureJitter> exposure;
    std::optional<PassingShadow> shadow;
};

/// Reads "NAME" (a scene of builtin_scene_names()) or "FILE.yaml". Throws UsageError for an unknown name (listing the
/// known ones), an unknown key (naming the nearest) or a value out of range; DataError for an unreadable file.
Description load_description(const std::string& name);

/// The same from YAML text; `origin` names it in messages.
Description parse_description(const std::string& text, const std::string& origin);

/// Camera `index` of the training or test set.
Camera rig_camera(const CameraRig& rig, bool test, int index);

/// The world as training view `index` saw it. Test views always see `description.world`.
World train_world(const Description& description, int index);

/// Settings of view `index` of the training or test set; neutral without jitter.
Photography photography(const Description& description, bool test, int index);

/// What reaches the sensor at a pixel, as a factor: 2^stops * gain * (1 - vignetting * r^2), r = distance of the pixel's centre
/// to that of the image, 1 in the corner.
Eigen::Vector3d exposure_factor(const Description& description, const Photography& photography, int x, int y);

/// Text of a built-in scene's YAML file; null when there is none of this name. Generated from scenes/procedural/.
const char* embedded_scene(const std::string& name);
/// All names that embedded_scene knows, sorted.
const std::vector<std::string>& embedded_scene_names();

}  // namespace gs::procedural
