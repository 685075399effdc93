// SPDX-License-Identifier: Apache-2.0
// One run from its options to its results: scene, choice of the appearance, training, evaluation, and the held-out
// views that measure progress towards a target PSNR.
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

/// The held-out views that measure whether a run has reached its target PSNR.
class TargetViews {
  public:
    /// Removes every 8th view from scene.train and keeps it. Throws UsageError if there are too few views, or if masks
    /// exclude every pixel of them.
    TargetViews(const TrainOptions& options, Scene& scene);

    /// Measures the PSNR of these views, with colours aligned if PPISP corrects exposures.
    HeldOutPsnr psnr(Backend& backend) const;
    std::size_t count() const { return photographs_.size(); }

  private:
    const Vec3<float> background_;
    const std::vector<Photograph> photographs_;
};

class RankGroup;

/// Returns <parent>/<scene>-<appearance>-<n> with the smallest n >= 1 for which no folder with that name followed by
/// `suffix` exists.
std::string free_run_folder(const std::filesystem::path& parent, const TrainOptions& options,
                            const std::string& suffix = "");

/// Settings for watching the training in a browser.
struct LiveView {
    std::optional<int> port;  ///< port on 127.0.0.1, 0 = any free one; empty = the default port, or any free one
};

/// Trains one run of checked options in the folder `options.model` (empty: a free one in output/). Chooses the
/// appearance first if the option is auto, and with `options.eval` scores the held-out views. `frame_rounds`: number of
/// rounds through these in which frames of the trained model are timed; 0 = none. Sets up the log, which is also
/// written to the folder, catches interrupts, and shows the progress. With a `group` this process is its rank 0.
/// Returns the result if views were scored. Throws the errors of load_scene, open_run, find_appearance and train.
std::optional<RunResult> train_run(TrainOptions options, int frame_rounds, const std::optional<LiveView>& view = {},
                                   RankGroup* group = nullptr);

}  // namespace gs
