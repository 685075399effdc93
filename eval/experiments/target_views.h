// SPDX-License-Identifier: Apache-2.0
// The views that tell whether a run has reached its target PSNR.
#pragma once

#include <vector>

#include "eval/auto/photograph.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/trainer.h"

namespace gs {

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

}  // namespace gs
