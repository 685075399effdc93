// SPDX-License-Identifier: Apache-2.0
// Opens a finished run, or a point cloud without one, for rendering and evaluation.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "eval/runs/evaluate.h"
#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/group/rank_group.h"
#include "lib/scene/scene.h"

namespace gs {

/// A finished run with its model on a backend.
struct SavedRun {
    std::filesystem::path folder;  ///< of a point cloud without a run, its file
    TrainOptions options;
    std::int64_t iteration = 0;
    std::unique_ptr<Backend> backend;  ///< holds the model
    Scene scene;
    EvalCorrection correction;        ///< the best that the model can do
    Vec3<float> background{0, 0, 0};  ///< colour for evaluation; black where training drew random ones
    /// Whether `scene` is another one than the run was trained on, as RunChanges::other_scene allows
    bool is_other_scene = false;
};

/// A model without its scene and options.
struct SavedModel {
    Gaussians state;  ///< Gaussians, with PPISP where ppisp.json exists
    std::int64_t iteration = 0;
    EvalCorrection correction = {};
    /// The frame that the Gaussians are in; empty for files of other programs, which are in scene coordinates.
    std::optional<Frame> frame = {};
};

/// Returns whether `path` stands for a point cloud without a run: a file, or a name that ends in .ply.
bool is_point_cloud(const std::filesystem::path& path);

/// Returns whether the folder holds point clouds or checkpoints, or is_point_cloud.
bool holds_model(const std::filesystem::path& run_folder);

/// Reads the model of `iteration` (of the last saved one when empty) from its PLY, or from its checkpoint where there
/// is no PLY. Throws DataError naming what is missing. Warns where ppisp.json is of another iteration. Also reads a
/// point cloud without a run, which has no iterations: UsageError if one is named.
SavedModel read_saved_model(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration);

/// Values that replace the run's own options where they are not empty.
struct RunChanges {
    std::string source = {};
    std::optional<Device> device = {};
    bool scores = false;       ///< SceneOptions::scores
    bool other_scene = false;  ///< whether `source` may be another scene than the run was trained on
    /// The options of point clouds without a run, which are refused where this is empty. `source` and `device` of this
    /// struct count for them, too.
    std::optional<TrainOptions> point_cloud = {};
    RankGroup* group = nullptr;  ///< ranks that hold the model's rows; null: this process alone
    bool needs_scene = true;     ///< whether a point cloud without a run is refused where no source is named
};

/// Loads the scene that `options` of the run options.model, or of a point cloud, name, in the frame of the model. A
/// model without one is moved into the scene's own frame. Throws what load_run_scene throws, but nothing for the
/// scene of a point cloud, or with RunChanges::other_scene the named one, that differs.
Scene load_scene_of(SavedModel& model, const TrainOptions& options, const RunChanges& changes = {});

/// Returns the options of a run with the changes, those of `instead` for a point cloud without a run. Throws UsageError
/// for a point cloud that `instead` does not allow, and DataError for a run whose scene is not known.
TrainOptions saved_options(const std::filesystem::path& run_folder, const RunChanges& instead);

/// Opens a model as read_saved_model does, and the scene that the run was trained on, or the one that `instead` names.
/// A point cloud without a run and without a scene has a scene without views. Throws what read_saved_model and
/// load_scene throw, and UsageError for a point cloud that `instead` does not allow.
SavedRun open_saved_run(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration,
                        const RunChanges& instead = {});

/// Reads the record of how `--appearance auto` chose the run's model; null if the model was named. Throws DataError
/// for a file that is no JSON object.
nlohmann::ordered_json read_appearance_choice(const std::filesystem::path& run_folder);

/// Puts the appearance of a model in the place of the options that choose one.
void set_appearance(TrainOptions& options, const AppearanceSpec& appearance);

/// Adds what options, scene and the model that `backend` holds say of a run: names, numbers and sizes, and how
/// `--appearance auto` chose.
void add_run_facts(RunResult& result, const TrainOptions& options, const Scene& scene, const Backend& backend);

}  // namespace gs
