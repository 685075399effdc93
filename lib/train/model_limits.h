// SPDX-License-Identifier: Apache-2.0
// Keeps a model within --size-limit and --frame-limit: during growth and at the end
// (docs/math/densification.md#limits).
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Limits a model by its number of Gaussians and by its render time. require_feasible() comes first, most_now() before
/// each growth, and prune() after the last step.
class ModelLimits {
  public:
    /// `most_at_end` is the largest number of Gaussians of the final model, 0 without a limit. `background` is the
    /// background of all frames. The references must outlive the object; `options` must be resolved.
    ModelLimits(const LimitOptions& options, const Scene& scene, const Vec3<float>& background,
                std::int64_t most_at_end);

    /// Returns whether there is a --frame-limit.
    bool limits_frames() const { return frame_limit_ > 0; }
    /// Returns render requests for all training views.
    std::vector<RenderRequest> views() const;
    /// Returns the mean render time of the first training views, in seconds, with sides `factor` times smaller.
    double view_seconds(Backend& backend, int factor = 1) const;
    /// Returns the ratio of the render time of a full frame to that of a frame with sides `factor` times smaller, at
    /// least 1.
    double coarse_ratio(Backend& backend, int factor) const;
    /// Returns the mean render time at 1280x720, in seconds, from some training views.
    double frame_seconds(Backend& backend) const;

    /// Returns the largest number of Gaussians at any time, apart from --frame-limit. It is a tenth more than at the
    /// end, so that enough remain after the Gaussians without effect are removed.
    std::int64_t cap() const;
    /// Returns the largest number of Gaussians that training may begin with; 0 = no limit.
    std::int64_t most_first_points() const { return most_at_end_; }
    /// Throws UsageError if even `smallest`, a model of one Gaussian, renders too slowly for --frame-limit. With a
    /// frame limit the backend holds `smallest` afterwards.
    void require_feasible(Backend& backend, const Gaussians& smallest) const;
    /// Returns the largest number of Gaussians that growth may reach now. Measures the render time again whenever the
    /// model has grown by a tenth.
    std::int64_t most_now(Backend& backend);

    /// Returns the time that prune() may take, in seconds.
    double seconds_to_prune(Backend& backend) const;
    /// Removes the Gaussians that contribute least to the training views until the limits hold, and logs the removals.
    void prune(Backend& backend) const;
    /// Removes the Gaussians with the lowest scores until `most` are left. `asks` is the name of the limit in the log.
    void prune_to(Backend& backend, std::int64_t most, const char* asks) const;

  private:
    const LimitOptions options_;
    const Scene& scene_;
    const Vec3<float> background_;
    const std::int64_t most_at_end_;
    const double frame_limit_;  ///< largest render time of a frame, seconds; 0 = none
    std::int64_t measured_count_ = 0, affordable_ = 0;
};

}  // namespace gs
