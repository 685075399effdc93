// SPDX-License-Identifier: Apache-2.0
// A loaded scene: views with their lenses, initial points, and notes on how they were obtained.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "lib/core/train_options.h"
#include "lib/io/image.h"
#include "lib/scene/camera_models.h"

namespace gs {

/// A similarity between scene coordinates, used in files, and frame coordinates, used in all computations
/// (lib/scene/frame.h). The axes keep their directions.
struct Frame {
    Eigen::Vector3d center = Eigen::Vector3d::Zero();  ///< origin of the frame, scene units
    double scale = 1;                                  ///< frame units per scene unit

    bool is_identity() const { return scale == 1 && center.isZero(0); }
    Eigen::Vector3d from_scene(const Eigen::Vector3d& p) const { return scale * (p - center); }
    Eigen::Vector3d to_scene(const Eigen::Vector3d& p) const { return p / scale + center; }
};

/// A camera in OpenCV axes: its lens, which is a pinhole unless the view keeps the photograph's own, and its pose.
struct Camera : LensCamera {
    LensRange range;                                         ///< of a lens that is no pinhole
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< rotation of cam_from_world
    Eigen::Vector3d translation = Eigen::Vector3d::Zero();   ///< translation of cam_from_world

    Eigen::Vector3d center() const { return -rotation.transpose() * translation; }
    /// Returns whether the lens is used at a direction of the camera's frame; a pinhole is everywhere.
    bool is_used_at(const Eigen::Vector3d& direction) const {
        return is_pinhole(*this) || direction.z() >= std::cos(range.max_angle) * direction.norm();
    }
};

/// The pixels of a view at the training size, ready for the loss.
struct ViewImage {
    Image color;                ///< 3 or 4 channels
    std::optional<Image> mask;  ///< 1 channel, 8 bit: loss weight
};

/// A point of the scene, and where an image shows it.
struct PointObservation {
    Eigen::Vector3d point;  ///< frame units
    Eigen::Vector2d at;     ///< as shares of the image's width and height
};

/// One photograph. `load` decodes (and undistorts if so decided, resizes, applies masks) on each call and is safe to
/// call from any thread. Callers that need an image twice use ImageCache.
struct View {
    std::string name;  ///< image name relative to the image folder, e.g. "left/0001.jpg"
    Camera camera;
    std::shared_ptr<const Camera> given;  ///< camera of the dataset, if `camera` is learned; else null
    std::function<ViewImage()> load;
    /// The result of `load` if verify_images kept it; else null.
    std::shared_ptr<const ViewImage> decoded;
    std::size_t image_bytes = 0;  ///< expected size of the result of `load`, for the memory plan
    /// Index of the device that took the photograph, 0..Scene::num_cameras-1; -1 = a device without training images
    int camera_id = 0;
    std::filesystem::path file;  ///< file of the photograph; empty if it is computed
    LensCamera photograph;       ///< lens for the photograph's own pixels
    std::string mask_file;       ///< file of its mask; empty without a mask
    /// The weights that the lens gives its pixels in the loss (1 channel, 8 bit), at the training size; null: all 255.
    /// Where they are 0 the lens sees nothing: the photograph is black, and scored renders are made so.
    std::shared_ptr<const Image> lens_weights;
    /// Points that the dataset says the image shows, at most kMostObservations; empty if it says nothing.
    std::vector<PointObservation> observations = {};
    /// Exposure in stops: log2(seconds * ISO/100 / f-number^2). Empty if the file does not state it or the option did
    /// not request it (SceneOptions::ppisp_exif).
    std::optional<double> exif_exposure;
};

/// Returns the image of a view: the kept image, or else a newly decoded one. Throws the errors of View::load, and
/// DataError if the image does not have the size of the view's camera.
std::shared_ptr<const ViewImage> view_image(const View& view);

struct PointCloud {
    std::vector<Eigen::Vector3f> positions;  ///< frame units
    std::vector<Eigen::Vector3f> colors;     ///< [0,1]
};

/// A loaded scene. All its lengths and positions are in the frame.
struct Scene {
    Frame frame;
    std::string source;        ///< name given by the user
    std::string kind;          ///< "colmap", "nerf-synthetic", "transforms", "builtin"
    std::string image_folder;  ///< e.g. "images_4"; empty if not applicable
    std::vector<View> train, test;
    /// Number of devices that took training images: the cameras of a COLMAP model, in the order of their ids. It is 1
    /// if the dataset does not distinguish devices; a COLMAP model with one camera per image does not.
    int num_cameras = 1;
    std::string split_rule;  ///< description of the split, in words; written to the results
    PointCloud points;       ///< empty = random initialisation
    bool has_alpha = false;  ///< images have an alpha channel
    /// Half the side of the cube for random initialisation, and its centre; 0 = derive both from the cameras (real
    /// scenes).
    double random_init_half_extent = 0;
    Eigen::Vector3d random_init_center = Eigen::Vector3d::Zero();
    /// E = 1.1 * max distance of a training camera from their mean (docs/math/optimization.md#scene-extent).
    double extent = 1;
    std::vector<std::string> notes;  ///< pre-flight findings: one line each with the finding and its consequence
    std::vector<std::string> facts;  ///< findings that need no action: one line each
};

/// Rules for loading a scene, beside the run's options.
struct LoadRules {
    std::optional<Frame> frame = {};  ///< frame of an existing model; empty = the scene's own
    bool scores = false;  ///< test views are scored: an unreadable one is an error instead of being left out
};

/// Loads a COLMAP folder, NeRF-synthetic folder, transforms.json folder/file, or "builtin:NAME". Throws DataError
/// naming file, field and value, and UsageError for invalid options.
Scene load_scene(const SceneOptions& options, const LoadRules& rules = {});

/// Returns the scene's name for folders and tables: the name of its folder, or the text after "builtin:" (for a file,
/// its stem).
std::string scene_name(const std::string& source);

/// Returns the name of the scene's dataset: "builtin", or the name of the folder that contains the scene's folder.
std::string dataset_name(const std::string& source);

/// Returns the number of views and a hash of their names ("12 9c0f..."). The text is equal for the same views in the
/// same order.
std::string view_digest(const std::vector<View>& views);

/// Removes the training views for which `unusable` is true, and recomputes cameras and extent from the remaining views.
/// The other arrays of the scene are unchanged.
void remove_training_views(Scene& scene, const std::vector<bool>& unusable);

/// Returns the centres of the cameras without those far outside of the others (far_cameras()), frame units.
std::vector<Eigen::Vector3d> usual_camera_centers(const std::vector<View>& views);

/// Returns the mean of the usual cameras' centres, frame units; 0 without views.
Eigen::Vector3d mean_camera_center(const std::vector<View>& views);

/// Returns the scene's extent E (docs/math/optimization.md#scene-extent), frame units. If the cameras are all in one
/// place, E is computed from the points. It is never zero.
double camera_extent(const std::vector<View>& views, const PointCloud& points);

}  // namespace gs
