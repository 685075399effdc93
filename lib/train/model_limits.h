// SPDX-License-Identifier: Apache-2.0
// Keeps a model within --size-limit and --frame-limit: while it grows, and at the end
// (docs/math/densification.md#limits).
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Bounds a model by its number of Gaussians and by the time of its frames. require_feasible() comes first, most_now()
/// before each growth, and prune() after the last step.
class ModelLimits {
  public:
    /// `most_at_end` is the largest number of Gaussians of the final model, 0 without a limit. `background` is that of
    /// all frames. The references must outlive the object; `options` must be resolved.
    ModelLimits(const LimitOptions& options, const Scene& scene, const Vec3<float>& background,
                std::int64_t most_at_end);

    /// Returns whether there is a --frame-limit.
    bool limits_frames() const { return frame_limit_ > 0; }
    /// Returns requests for all training views.
    std::vector<RenderRequest> views() const;
    /// Returns the mean seconds of a frame of the first training views, whose sides are `factor` times smaller.
    double view_seconds(Backend& backend, int factor = 1) const;
    /// Returns how many times as long a frame takes as one whose sides are `factor` times smaller; at least 1.
    double coarse_ratio(Backend& backend, int factor) const;
    /// Returns the mean seconds of a frame at 1280x720 with the focal lengths of some training views.
    double frame_seconds(Backend& backend) const;

    /// Returns the most Gaussians at any time but for --frame-limit: a tenth more than at the end, so that enough are
    /// left when those without effect are gone.
    std::int64_t cap() const;
    /// Returns the most Gaussians that training may begin with; 0 = no limit.
    std::int64_t most_first_points() const { return most_at_end_; }
    /// Throws UsageError if not even frames of `smallest`, a model of one Gaussian, are as fast as --frame-limit. The
    /// backend holds that model afterwards.
    void require_feasible(Backend& backend, const Gaussians& smallest) const;
    /// Returns the most Gaussians that growth may lead to now. Measures frames when the model has grown by a tenth.
    std::int64_t most_now(Backend& backend);

    /// Returns the seconds that prune() may take.
    double seconds_to_prune(Backend& backend) const;
    /// Removes those Gaussians that the training views depend on least, until the limits hold. Logs what it did.
    void prune(Backend& backend) const;
    /// Removes the Gaussians with the lowest scores until `most` are left. `asks` names the limit in the log.
    void prune_to(Backend& backend, std::int64_t most, const char* asks) const;

  private:
    const LimitOptions options_;
    const Scene& scene_;
    const Vec3<float> background_;
    const std::int64_t most_at_end_;
    const double frame_limit_;  ///< seconds; 0 = none
    std::int64_t measured_count_ = 0, affordable_ = 0;
};

}  // namespace gs
