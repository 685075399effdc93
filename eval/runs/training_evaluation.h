// SPDX-License-Identifier: Apache-2.0
// Measures the held-out views while a run is trained, and when it has ended.
#pragma once

#include <cstdint>
#include <filesystem>

#include "eval/runs/results.h"
#include "kernels/ranks/backend.h"
#include "lib/core/progress.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/trainer.h"

namespace gs {

/// Adds time, memory and photometric decision of a training. The time of a part is not that of the run.
void add_training(RunResult& result, const TrainSummary& summary);

/// Takes the place of TrainHooks::evaluate and keeps the latest scores.
class TrainingEvaluation {
  public:
    /// `scene` has test views. `frame_rounds`: rounds through these in which frames of the trained model are timed; 0 =
    /// none. The references have to outlive the object.
    TrainingEvaluation(const TrainOptions& options, const Scene& scene, Progress& progress, int frame_rounds);

    /// Scores the test views after `iteration` iterations and writes results.json. After the last iteration also writes
    /// the pictures and comparison.png. Returns the means.
    std::optional<TestScores> operator()(std::int64_t iteration, Backend& backend, bool last);

    /// Adds to results.json what is known only after the training: add_training, how the appearance was chosen, and the
    /// `plan` with what came of it, null if there was none.
    void finish(const TrainSummary& summary, const nlohmann::ordered_json& plan = {});

    /// The iteration that was scored last; 0 = none yet.
    std::int64_t iteration() const { return result_.iteration; }

  private:
    std::filesystem::path comparison() const;

    const TrainOptions& options_;
    const Scene& scene_;
    Progress& progress_;
    const int frame_rounds_;
    Vec3<float> background_;
    RunResult result_;
};

}  // namespace gs
