// SPDX-License-Identifier: Apache-2.0
// Scores the held-out views during training and at its end.
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

/// Adds time, memory and photometric decision of a training. The time of one part is not added as that of the run.
void add_training(RunResult& result, const TrainSummary& summary);

/// Implements TrainHooks::evaluate and keeps the latest scores.
class TrainingEvaluation {
  public:
    /// `scene` must have test views. `frame_rounds`: number of rounds through these in which frames of the trained
    /// model are timed; 0 = none. The references must outlive the object.
    TrainingEvaluation(const TrainOptions& options, const Scene& scene, Progress& progress, int frame_rounds);

    /// Scores the test views after `iteration` iterations and writes results.json. After the last iteration also writes
    /// the images, comparison.png, and pictures of cameras that were corrected much. Returns the means.
    std::optional<TestScores> operator()(std::int64_t iteration, Backend& backend, bool last);

    /// Adds to results.json the values known only after training: those of add_training, how the appearance was chosen,
    /// and the `plan` with its outcome, null without a plan.
    void finish(const TrainSummary& summary, const nlohmann::ordered_json& plan = {});

    /// Returns the iteration that was scored last; 0 = none yet.
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
