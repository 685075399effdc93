// SPDX-License-Identifier: Apache-2.0
// Opens a finished run, or a point cloud without a run, for rendering and evaluation.
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
    std::filesystem::path folder;  ///< folder of the run; for a point cloud without a run, its file
    TrainOptions options;
    std::int64_t iteration = 0;
    std::unique_ptr<Backend> backend;  ///< holds the model
    Scene scene;
    EvalCorrection correction;        ///< best correction that the model supports
    Vec3<float> background{0, 0, 0};  ///< colour for evaluation; black if training drew random ones
    /// Whether `scene` is a different scene than the run was trained on (see RunChanges::other_scene)
    bool is_other_scene = false;
};

/// A model without scene and options.
struct SavedModel {
    Gaussians state;  ///< Gaussians, with PPISP if ppisp.json exists
    std::int64_t iteration = 0;
    EvalCorrection correction = {};
    /// Frame of the Gaussians; empty for files of other programs, which are in scene coordinates.
    std::optional<Frame> frame = {};
};

/// Returns whether `path` names a point cloud without a run: an existing path that is no folder, or a name ending in
/// .ply.
bool is_point_cloud(const std::filesystem::path& path);

/// Returns whether the folder holds point clouds or checkpoints, or whether the path is a point cloud (is_point_cloud).
bool holds_model(const std::filesystem::path& run_folder);

/// Reads the model of `iteration` (empty: the last saved iteration) from its PLY, or from its checkpoint if there is no
/// PLY. Throws DataError naming the missing file. Warns if ppisp.json belongs to another iteration. Also reads a point
/// cloud without a run, which has no iterations: throws UsageError if one is given.
SavedModel read_saved_model(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration);

/// Values that replace the run's own options unless they are empty.
struct RunChanges {
    std::string source = {};
    std::optional<Device> device = {};
    std::optional<LensMode> lens = {};  ///< with other_scene: how photographs are used that are no pinhole's
    bool scores = false;                ///< SceneOptions::scores
    bool other_scene = false;           ///< whether `source` may be a different scene than the run was trained on
    /// Options for point clouds without a run; if empty, such point clouds are refused. `source` and `device` of this
    /// struct apply to them, too.
    std::optional<TrainOptions> point_cloud = {};
    RankGroup* group = nullptr;  ///< ranks that hold the model's rows; null: this process alone
    bool needs_scene = true;     ///< whether a point cloud without a run is refused if no source is given
};

/// Loads the scene of `options`, the options of a run or of a point cloud, in the frame of the model. A model without a
/// frame is moved into the scene's frame. Throws the errors of load_run_scene; the scene may differ for a point cloud,
/// and with RunChanges::other_scene if changes.source names it.
Scene load_scene_of(SavedModel& model, const TrainOptions& options, const RunChanges& changes = {});

/// Returns the options of a run with the changes applied; for a point cloud without a run, the options in `instead`.
/// Throws UsageError for a point cloud that `instead` does not allow, and DataError for a run whose scene is not known.
TrainOptions saved_options(const std::filesystem::path& run_folder, const RunChanges& instead);

/// Opens a model as read_saved_model does, with the scene that the run was trained on or the scene in `instead`. A
/// point cloud without run and scene gets a scene without views. Throws the errors of read_saved_model and load_scene,
/// and UsageError for a point cloud that `instead` does not allow.
SavedRun open_saved_run(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration,
                        const RunChanges& instead = {});

/// Reads the record of how `--appearance auto` chose the run's model; null if the user chose the model. Throws
/// DataError for a file that is not a JSON object.
nlohmann::ordered_json read_appearance_choice(const std::filesystem::path& run_folder);

/// Sets the appearance options to those of a model.
void set_appearance(TrainOptions& options, const AppearanceSpec& appearance);

/// Adds the names, numbers and sizes of a run from its options, its scene and the model that `backend` holds, and the
/// record of `--appearance auto`.
void add_run_facts(RunResult& result, const TrainOptions& options, const Scene& scene, const Backend& backend);

}  // namespace gs
