// SPDX-License-Identifier: Apache-2.0
// One run from its options to its results: scene, choice of the appearance, training, evaluation, and the views that
// tell whether a target PSNR is reached.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/auto/photograph.h"
#include "eval/runs/results.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/trainer.h"

namespace gs {

/// The views that tell whether a run has reached its target PSNR.
class TargetViews {
  public:
    /// Takes every 8th view out of scene.train. Throws UsageError if there are too few, or if masks leave none.
    TargetViews(const TrainOptions& options, Scene& scene);

    /// Measures them, with colours aligned where PPISP corrects exposures.
    HeldOutPsnr psnr(Backend& backend) const;
    std::size_t count() const { return photographs_.size(); }

  private:
    const Vec3<float> background_;
    const std::vector<Photograph> photographs_;
};

class RankGroup;

/// Returns <parent>/<scene>-<appearance>-<n> with the first n from 1 on for which no folder of that name with `suffix`
/// behind it exists.
std::string free_run_folder(const std::filesystem::path& parent, const TrainOptions& options,
                            const std::string& suffix = "");

/// That the training is shown in a browser while it goes on.
struct LiveView {
    std::optional<int> port;  ///< on 127.0.0.1, 0 = any free one; empty = the usual one, or any free one
};

/// Trains one run of checked options in the folder `options.model` (empty: a free one in output/), chooses the
/// appearance before where the options say auto, and with `options.eval` scores the views held out. `frame_rounds`:
/// rounds through these in which frames of the trained model are timed; 0 = none. Sets up the log, which also goes to
/// the folder, catches interrupts, and shows the progress. With a `group` this is its rank 0. Returns the result
/// where views were scored. Throws what load_scene, open_run, find_appearance and train throw.
std::optional<RunResult> train_run(TrainOptions options, int frame_rounds, const std::optional<LiveView>& view = {},
                                   RankGroup* group = nullptr);

}  // namespace gs
