// SPDX-License-Identifier: Apache-2.0
// What a run does about photometric differences between its images: PPISP off, on, decided by the images, or of another run.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "kernels/backend.h"
#include "lib/core/train_options.h"
#include "lib/model/ppisp_json.h"
#include "lib/scene/scene.h"
#include "lib/train/photometric_variation.h"

namespace gs {

/// Iteration at which --ppisp auto decides: late enough for a rough scene, early enough for colour not to depend on the view yet
/// (degree 1 begins here). Not a share of the run's length, so that a resumed run may be longer.
inline constexpr std::int64_t kPhotometricDecision = 1000;

/// Standard deviation of the exposures, in stops. Between scenes that need no waiting (bonsai at 200 pixels: 0.10) and
/// those that lose by not waiting (builtin:exposure: 0.21 after 1000 iterations, 0.4 after 4000).
inline constexpr double kSpreadThatHolds = 0.15;
/// Iterations after which view dependence begins in any case; a third of a shorter run.
inline constexpr std::int64_t kLongestHold = 10000;

/// How auto decided.
struct PhotometricDecision {
    bool on = false;
    PhotometricVariation variation;
};
/// "on: images vary by 0.55 stops, threshold 0.1".
std::string describe(const PhotometricDecision& decision);

/// Rate of PPISP's parameters after `steps` finished steps of theirs: `rate` after a slow start, falling by 100 in
/// 30000 (docs/math/ppisp.md#optimizer).
double ppisp_rate(double rate, std::int64_t steps);
/// Rate of the controllers' weights.
inline constexpr double kControllerRate = 0.001;

class Photometric {
  public:
    /// Reads options.ppisp_from and matches it with the training images by name. Throws DataError where an image or camera has no
    /// counterpart there, and UsageError where only one of the two runs uses EXIF.
    Photometric(const TrainOptions& options, const Scene& scene);

    /// What a new run begins with; inactive where PPISP is off or not yet decided.
    const PpispState& initial_state() const { return initial_; }

    /// Takes up a run after `iteration` iterations. Where PPISP is on but the checkpoint has none it begins there. Throws UsageError
    /// for a checkpoint with PPISP where it is off, DataError for one of other numbers of images or cameras.
    void resume(Gaussians& state, std::int64_t iteration);

    /// Before the step of `iteration`: decides, where auto is due, and gives the backend the state to begin with.
    std::optional<PhotometricDecision> decide(Backend& backend, std::int64_t iteration, const Vec3<float>& background,
                                              const std::function<std::shared_ptr<const ViewImage>(std::size_t)>& image);

    /// Whether colours should not yet depend on the view: the exposures found so far differ by more than kSpreadThatHolds, and the first
    /// third of the run is not over. View dependence would take up some of them, and not give it back.
    bool holds_view_dependence(Backend& backend, std::int64_t iteration);

    /// Training image `view` by its own values.
    void apply(std::size_t view, std::int64_t iteration, StepRequest& request) const;

    /// Whether controllers are to be trained once the Gaussians are done.
    bool trains_controllers() const { return active_ && !frozen_ && options_.controller_iterations > 0; }
    void add_controllers(Backend& backend) const;
    /// Training image `view` by its camera's controller.
    void apply_controller(std::size_t view, StepRequest& request) const;

    bool active() const { return active_; }
    /// Logs how well exposures agree with EXIF, where images have it.
    void report(Backend& backend) const;
    /// Writes ppisp.json where PPISP is active.
    void save(const std::filesystem::path& path, Backend& backend, std::int64_t iteration) const;

  private:
    PpispState begin() const;
    void take_from(const std::filesystem::path& path);
    float prior(std::size_t view) const;

    const TrainOptions& options_;
    const Scene& scene_;
    PpispFile file_;      ///< what ppisp.json says besides the numbers
    PpispState initial_;
    bool active_ = false, frozen_ = false, held_ = false;
    std::int64_t first_ = 0;  ///< iteration of PPISP's first step
};

}  // namespace gs
