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

/// Each training view is multiplied by 2^(stops*u), u uniform in (-1, 1).
struct ExposureJitter {
    double stops = 0.5;
    std::uint64_t seed = 0;
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

/// Exposure factor of training view `index`; 1 without jitter.
double train_exposure(const Description& description, int index);

/// Text of a built-in scene's YAML file; null when there is none of this name. Generated from scenes/procedural/.
const char* embedded_scene(const std::string& name);
/// All names that embedded_scene knows, sorted.
const std::vector<std::string>& embedded_scene_names();

}  // namespace gs::procedural
