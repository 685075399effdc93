// SPDX-License-Identifier: Apache-2.0
// A finished run, opened again for rendering and evaluation.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "eval/runs/results.h"
#include "kernels/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

struct SavedRun {
    std::filesystem::path folder;
    TrainOptions options;
    std::int64_t iteration = 0;
    std::unique_ptr<Backend> backend;  ///< holds the model
    Scene scene;
    EvalCorrection correction;  ///< the best that the model can do
    Vec3<float> background{0, 0, 0};  ///< for evaluation: black when the training drew random ones
};

/// A model without the scene and the options it came from.
struct SavedModel {
    Gaussians state;  ///< with PPISP from ppisp.json, where there is one
    std::int64_t iteration = 0;
    EvalCorrection correction = {};
};

/// Whether a point cloud or a checkpoint is in the folder.
bool holds_model(const std::filesystem::path& run_folder);

/// The model of `iteration` (the last saved one when empty): its PLY, or its checkpoint where there is no PLY. Throws
/// DataError naming what is missing. Warns where ppisp.json is of another iteration.
SavedModel read_saved_model(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration);

/// What is taken instead of the run's own option, where not empty.
struct RunChanges {
    std::string source = {};
    std::optional<Device> device = {};
};

/// Opens a model as read_saved_model does, and the scene the run was trained on (or another, loaded with the run's options). Throws what
/// load_scene throws, too.
SavedRun open_saved_run(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration, const RunChanges& instead = {});

/// How `--appearance auto` chose the run's model; null where it was named. Throws DataError for a file that is no JSON object.
nlohmann::ordered_json read_appearance_choice(const std::filesystem::path& run_folder);

/// What results.json says about a run with these options.
RunFacts run_facts(const TrainOptions& options, const Scene& scene, const Vec3<float>& background, std::int64_t num_gaussians);

}  // namespace gs
