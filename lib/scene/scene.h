// SPDX-License-Identifier: Apache-2.0
// A loaded scene: undistorted pinhole views, initial points, and how they were obtained.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lib/io/image.h"

namespace gs {

/// Pinhole camera in OpenCV axes; pixel (0,0) has its centre at (0.5,0.5).
struct Camera {
    int width = 0, height = 0;
    double fx = 0, fy = 0, cx = 0, cy = 0;
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity(); ///< of cam_from_world
    Eigen::Vector3d translation = Eigen::Vector3d::Zero();  ///< of cam_from_world

    Eigen::Vector3d center() const { return -rotation.transpose() * translation; }
};

/// Pixels of a view at the training size, ready for the loss.
struct ViewImage {
    Image color;               ///< 3 or 4 channels
    std::optional<Image> mask; ///< 1 channel, 8 bit: loss weight
};

/// One photograph. `load` decodes (and undistorts, resizes, applies masks) on each call and is safe to call from any
/// thread; callers that need an image twice go through ImageCache.
struct View {
    std::string name;          ///< image name relative to the image folder, e.g. "left/0001.jpg"
    Camera camera;
    std::function<ViewImage()> load;
    std::size_t image_bytes = 0; ///< expected bytes of `load()`, for the memory plan
    int camera_id = 0;           ///< which device took it, 0..Scene::num_cameras-1; -1 = one that took no training image
    /// How much light the device let in, stops: log2(seconds * ISO/100 / f-number^2). Empty where the file does not say, or
    /// nobody asked (SceneOptions::exif).
    std::optional<double> exif_exposure;
};

struct PointCloud {
    std::vector<Eigen::Vector3f> positions; ///< world
    std::vector<Eigen::Vector3f> colors;    ///< [0,1]
};

struct Scene {
    std::string source;           ///< as the user named it
    std::string kind;             ///< "colmap", "nerf-synthetic", "transforms", "builtin"
    std::string image_folder;     ///< e.g. "images_4"; empty where not applicable
    std::vector<View> train, test;
    /// Devices that took training images: the cameras of a COLMAP model, in the order of their ids. One where the dataset does
    /// not tell devices apart, which includes a COLMAP model with a camera for every image.
    int num_cameras = 1;
    std::string split_rule;       ///< in words, written to the results
    PointCloud points;            ///< may be empty: random initialisation
    bool has_alpha = false;       ///< images carry alpha
    /// Half side of the cube for random initialisation, world units; 0 = derive from the cameras (real scenes).
    double random_init_half_extent = 0;
    /// E = 1.1 * max distance of a training camera from their mean (docs/math/optimization.md#scene-extent).
    double extent = 1;
    std::vector<std::string> notes; ///< pre-flight findings: one line each, what was found and what is done about it
};

struct SceneOptions {
    std::string source;
    std::string images = "images";
    int resolution = -1;          ///< 1,2,4,8 = divisor; larger = width in pixels; -1 = cap at 1600 px and say so
    bool eval = false;            ///< hold out test views
    int test_every = 8;           ///< every n-th of the name-sorted list; 0 = none
    std::string test_list;        ///< file with one image name per line; overrides test_every
    std::string mask_mode = "ignore"; ///< "ignore" = loss weight, "transparent" = target composited on the background
    bool invert_masks = false;
    std::string alpha_mode = "transparent"; ///< for RGBA photographs: "transparent" or "mask"
    bool exif = false;            ///< read View::exif_exposure, which opens every file once more
    std::uint64_t seed = 0;
};

/// Loads a COLMAP folder, NeRF-synthetic folder, transforms.json folder/file, or "builtin:NAME".
/// Throws DataError naming file, field and value.
Scene load_scene(const SceneOptions& options);

/// E of optimization.md section 4 with its guards (one camera, zero extent).
double camera_extent(const std::vector<View>& views, const PointCloud& points);

}  // namespace gs
