// SPDX-License-Identifier: Apache-2.0
// The views that tell whether a run has reached its target PSNR.
#pragma once

#include <vector>

#include "eval/auto/photograph.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

class TargetViews {
  public:
    /// Takes every 8th view out of scene.train. Throws UsageError if there are too few, or if masks leave none.
    TargetViews(const TrainOptions& options, Scene& scene);

    /// Returns their mean PSNR, dB, with colours aligned where PPISP corrects exposures.
    double psnr(Backend& backend);
    std::size_t count() const { return photographs_.size(); }
    /// Returns how far the last mean may be off by the choice of views, dB: its standard error.
    double standard_error() const;

  private:
    const bool aligned_;
    const Vec3<float> background_;
    std::vector<Photograph> photographs_;
    std::vector<double> last_;
};

}  // namespace gs
