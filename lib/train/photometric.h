// SPDX-License-Identifier: Apache-2.0
// Handles photometric differences between a run's images: PPISP is off, on, or taken from another run.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/model/ppisp_json.h"
#include "lib/scene/scene.h"
#include "lib/train/timeline.h"

namespace gs {

/// The standard deviation of the exposures, in stops, above which view dependence is delayed. It lies between scenes
/// that need no delay (bonsai at 200 pixels: 0.10) and scenes that lose quality without a delay (builtin:exposure: 0.21
/// after 1000 iterations, 0.4 after 4000).
inline constexpr double kSpreadThatHolds = 0.15;
/// The position from which colours depend on the view in any case.
inline constexpr double kLongestHold = 10000;

/// Returns the standard deviation of the images' exposures, in stops; 0 without PPISP.
double exposure_spread(const PpispState& state);

/// Returns the learning rate of PPISP's parameters `distance` positions after PPISP began: a warm-up to `rate`, then a
/// decay by a factor of 100 in 30000 positions (docs/math/ppisp.md#optimizer). `distance` is negative if the schedule
/// of a later segment begins before the position at which PPISP began; the rate is then the initial one.
double ppisp_rate(double rate, double distance);
/// The learning rate of the controllers' weights.
inline constexpr double kControllerRate = 0.001;

/// PPISP in a run: off, on, or taken from another run. A new run begins with initial_state(), a resumed run with
/// resume(). Before every step, call apply() on the step's request. After the last change of the Gaussians, call
/// add_controllers(), then apply_controller() for each controller step.
class Photometric {
  public:
    /// Throws UsageError if options.ppisp is auto, which is decided before. Reads options.ppisp_from, if set, and
    /// matches it with the training images by name. Throws DataError if an image has no counterpart there or the
    /// numbers of cameras differ, UsageError if only one of the two runs uses EXIF. Both arguments must outlive the
    /// object.
    Photometric(const TrainOptions& options, const Scene& scene);

    /// Returns the PPISP state with which a new run begins; inactive if PPISP is off.
    const PpispState& initial_state() const { return initial_; }

    /// Continues a run at `moment`. If PPISP is on but the checkpoint has no PPISP state, PPISP begins at `moment`.
    /// Throws UsageError for a checkpoint with PPISP if PPISP is off, DataError for a checkpoint with other numbers of
    /// images or cameras.
    void resume(Gaussians& state, const ScheduleMoment& moment);

    /// Returns whether colours should not yet depend on the view: the standard deviation of the learned exposures
    /// exceeds kSpreadThatHolds, and the first third of the run is not over. Otherwise view dependence would
    /// permanently absorb part of the exposure.
    bool holds_view_dependence(Backend& backend, const ScheduleMoment& moment);

    /// Sets `request` to correct training image `view` by the image's own parameters.
    void apply(std::size_t view, const ScheduleMoment& moment, StepRequest& request) const;

    /// Returns whether controllers are to be trained after the Gaussians.
    bool trains_controllers() const { return active_ && !frozen_ && options_.controller_iterations != 0; }
    void add_controllers(Backend& backend) const;
    /// Sets `request` to correct training image `view` by its camera's controller.
    void apply_controller(std::size_t view, StepRequest& request) const;

    bool active() const { return active_; }
    /// Logs how well the learned exposures agree with EXIF, if the images have EXIF exposures.
    void report(Backend& backend) const;
    /// Writes ppisp.json if PPISP is active. Throws DataError.
    void save(const std::filesystem::path& path, Backend& backend, std::int64_t iteration) const;

  private:
    PpispState begin() const;
    void take_from(const std::filesystem::path& path);
    float prior(std::size_t view) const;

    const PhotometricOptions options_;
    const bool exif_;
    const std::uint64_t seed_;
    const double longest_hold_;  ///< position from which colours depend on the view in any case
    const Scene& scene_;
    PpispFile file_;  ///< fields of ppisp.json other than the parameters
    PpispState initial_;
    bool active_ = false, frozen_ = false, held_ = false;
    double first_ = 0;  ///< position of PPISP's first step
};

}  // namespace gs
