// SPDX-License-Identifier: Apache-2.0
// The result of the dataset readers: images with their lenses, before undistortion, resizing and the split.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "lib/scene/camera_models.h"
#include "lib/scene/image_files.h"
#include "lib/scene/masks.h"
#include "lib/scene/scene.h"

namespace gs {

/// Largest number of observations of an image that are read. They are spread evenly over its list.
inline constexpr std::size_t kMostObservations = 500;

/// The use that a dataset states for one of its views.
enum class ViewRole {
    kTrain,
    kTest,    ///< in the test set
    kLeftOut  ///< in neither set
};

struct SourceView {
    std::string name;
    std::filesystem::path image_path;                        ///< exists and has a readable header
    ImageInfo info;                                          ///< size after turning by `turn`
    int turn = 1;                                            ///< EXIF orientation applied to the pixels on reading
    LensCamera lens;                                         ///< lens for the image's actual size
    Camera camera = {};                                      ///< of the view at the image's full size, without a pose
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< rotation of cam_from_world
    Eigen::Vector3d translation = Eigen::Vector3d::Zero();
    int camera_id = 0;  ///< device that took it, in the dataset's numbering
    std::optional<MaskFile> mask;
    /// As in View, but with points in scene units and shares of the size of `lens`
    std::vector<PointObservation> observations = {};
    ViewRole role = ViewRole::kTrain;
    /// Reason why the image cannot be read; empty if it can. An unreadable view counts in the split and is then left
    /// out.
    std::string unreadable = {};

    Eigen::Vector3d center() const { return -rotation.transpose() * translation; }  ///< of the camera, scene units
};

/// Points as read from files, scene units. Positions are doubles, so that map coordinates stay exact.
struct SourcePoints {
    std::vector<Eigen::Vector3d> positions;
    std::vector<Eigen::Vector3f> colors;  ///< [0,1]
};

struct SourceScene {
    std::string kind, image_folder;
    std::vector<SourceView> views;
    std::string given_split;  ///< name of the dataset's own split; empty if it has none
    /// Whether the test views of that split are used for training if none are held out (no --eval), as in 3DGS
    bool test_views_train = false;
    /// Divisor by which the image folder is already scaled for SceneOptions::resolution; 1 = none
    int prescaled = 1;
    SourcePoints points;
    /// Whether views and points follow the convention of Blender's NeRF-synthetic scenes: the cameras look at the
    /// centre of a cube around the origin.
    bool is_object_in_cube = false;
    std::vector<std::string> notes, facts;  ///< as in Scene
};

/// Returns the first items as a list in words: "a.jpg, b.jpg, c.jpg and 7 more".
std::string listed(const std::vector<std::string>& items);

/// Checks image files before they are used and collects the problems.
class Preflight {
  public:
    /// Fills view.image_path and view.info and returns true if the image has a file with a readable header and
    /// view.name is new. Otherwise records why the view is left out and returns false; if the image exists but cannot
    /// be read, view.unreadable is set as well.
    bool accept_file(SourceView& view, const FoundImage& image);

    /// Records that an accepted view is left out because its camera cannot be used.
    void reject_camera(const std::string& reason) { cameras_.push_back(reason); }

    /// Decides whether to turn the image by its EXIF orientation: if this is a quarter turn, and view.lens is in
    /// portrait format and the stored pixels in landscape format, or vice versa. Otherwise the camera matches the
    /// pixels as stored.
    void choose_turn(SourceView& view);

    /// Scales view.lens from its nominal size to the size of view.info, and records any difference.
    void fit_lens(SourceView& view);

    /// Returns one line per kind of finding. Throws DataError, starting with `where`, if no image was accepted.
    std::vector<std::string> report(const std::string& where) const;

  private:
    std::vector<std::string> missing_, contested_, cameras_, unreadable_, duplicate_, rescaled_, turned_, kept_;
    std::set<std::string> names_, unreadable_names_;
};

/// Adds one line each to scene.notes about points in no image (if more than 5 %), points that are nearer than the near
/// plane or beyond the far plane in every image that contains them, and cameras that see no point. `scene` needs its
/// views, points and frame.
void check_points(Scene& scene);

/// Adds notes about masks that the dataset lists as images, and about mask folders whose names match no image.
void note_mask_findings(const MaskFinder& masks, const std::vector<std::string>& listed_as_images, SourceScene& scene);

/// Loads the COLMAP scene in the folder `scene`, whose model lies in the folder `model`. Throws DataError.
SourceScene load_colmap(const std::filesystem::path& scene, const std::filesystem::path& model,
                        const SceneOptions& options);
/// Loads the folder that holds transforms_train.json. Throws DataError.
SourceScene load_nerf_synthetic(const std::filesystem::path& folder, const SceneOptions& options);
/// Loads one transforms.json. Throws DataError.
SourceScene load_transforms(const std::filesystem::path& file, const SceneOptions& options);

}  // namespace gs
