// SPDX-License-Identifier: Apache-2.0
// The content of a procedural scene's YAML file: the world, the cameras, and the deviations of views from the static
// world.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/procedural_caster.h"

namespace gs::procedural {

/// Cameras on a spherical cap around `look_at`. They look at it, or up to `turn` beside it, with world z up in the
/// picture.
struct CameraRig {
    int width = 160, height = 120;  ///< pixels
    double fov = 45;                ///< horizontal field of view, degrees
    CameraModel model = CameraModel::kPinhole;
    std::array<double, 12> distortion{};            ///< as in LensCamera
    double radius = 4;                              ///< distance to look_at, world units
    double elevation_min = 15, elevation_max = 60;  ///< degrees above the horizon
    Eigen::Vector3d look_at{0, 0, 0};
    double turn = 0;           ///< largest angle to the direction of look_at, degrees; all on this cap are as likely
    int train = 40, test = 8;  ///< number of views
};

/// Moves the shape `shape` by `offset` in every `every`-th training view.
struct MovedShape {
    std::string shape;
    Eigen::Vector3d offset{0, 0, 0};
    int every = 2;
};

/// Camera settings that differ from view to view, for training and test views. Each setting is drawn uniformly and
/// depends only on (seed, set, index). One device takes all views.
struct ExposureJitter {
    double stops = 0.5;        ///< exposure: factor 2^e, e in (-stops, stops)
    double white_balance = 0;  ///< channel factors 2^g, g in (-white_balance, white_balance) minus their mean
    /// Fraction of light lost in the corner of the image, 0..1; grows with the square of the distance to the centre
    double vignetting = 0;
    std::uint64_t seed = 0;
};

/// The camera settings of one view.
struct Photography {
    double stops = 0;                                ///< exposure
    Eigen::Vector3d gain = Eigen::Vector3d::Ones();  ///< white balance factor per channel; their product is 1
};

/// An invisible sphere that blocks the light in every `every`-th training view. It moves from `from` to `to` over the
/// views.
struct PassingShadow {
    Eigen::Vector3d from{0, 0, 0}, to{0, 0, 0};
    double radius = 0.5;
    int every = 2;
};

/// Other things in every training view, as people and cars in photographs of a place: spheres and boxes of random
/// sizes, colours and places between the camera and the scene, until they cover `share` of the picture. They cast no
/// shadows. They cast no shadows.
struct Distractors {
    double share = 0.1;
    std::uint64_t seed = 0;
};

struct Description {
    World world;
    CameraRig cameras;
    int pixel_grid = 2;  ///< rays per pixel along each axis
    int points = 5000;   ///< number of initial points
    std::optional<MovedShape> moved;
    std::optional<ExposureJitter> exposure;
    std::optional<PassingShadow> shadow;
    std::optional<Distractors> distractors;
};

/// Reads "NAME" (a scene of builtin_scene_names()) or "FILE.yaml". Throws UsageError for an unknown name (listing the
/// known ones), an unknown key (naming the nearest) or a value out of range; DataError for an unreadable file.
Description load_description(const std::string& name);

/// Reads a description from YAML text; `origin` names the text in messages. Throws UsageError as load_description does.
Description parse_description(const std::string& text, const std::string& origin);

/// Returns the lens of all cameras: its field of view fills the image's width.
LensCamera rig_lens(const CameraRig& rig);

/// Returns camera `index` of the training or test set.
Camera rig_camera(const CameraRig& rig, bool test, int index);

/// Returns the world that training view `index` sees. Test views always see `description.world`.
World train_world(const Description& description, int index);

/// Returns the camera settings of view `index` of the training or test set; neutral without jitter.
Photography photography(const Description& description, bool test, int index);

/// Returns the exposure factor of each channel of pixel (x, y): 2^stops * gain * (1 - vignetting * r^2). r is the
/// distance of the pixel's centre from the image's centre, 1 in the corner.
Eigen::Vector3d exposure_factor(const Description& description, const Photography& photography, int x, int y);

/// Returns the text of a built-in scene's YAML file, or null if no scene has this name. Generated from
/// scenes/procedural/.
const char* embedded_scene(const std::string& name);
/// Returns all names that embedded_scene accepts, sorted.
const std::vector<std::string>& embedded_scene_names();

}  // namespace gs::procedural
