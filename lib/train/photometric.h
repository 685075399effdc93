// SPDX-License-Identifier: Apache-2.0
// Handles photometric differences between a run's images: measures whether they differ in ways that no scene explains,
// and has PPISP off, on, decided by that, or taken from another run.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/model/ppisp_json.h"
#include "lib/scene/scene.h"
#include "lib/train/timeline.h"

namespace gs {

/// With --ppisp auto the correction is on if the images vary by more than this, in stops. The value is the geometric
/// middle between the scenes whose images are known to be alike (0.02 to 0.05; the largest are lego, and builtin:shadow
/// with its moving shadow) and the lowest of the others (bonsai 0.11; builtin:exposure 0.53).
inline constexpr double kPhotometricThreshold = 0.075;

/// Whether photographs differ in ways that no scene explains: exposure, white balance.
struct PhotometricVariation {
    double stops = 0;             ///< standard deviation over the images of the brightness common to a whole image
    int num_images = 0;           ///< number of images compared
    std::string nothing_to_tell;  ///< reason why there is no figure; empty if there is one
};

/// Compares up to 64 training images, spread over the scene, with renders of a model whose colour does not depend on
/// the view and which so cannot follow single images. Measures how much brighter or darker whole images are than their
/// render, per channel.
///
/// An image is cut into 4x4 blocks; each gives log2(sum of the image / sum of the render). The part that all images
/// have in common at a block (vignetting, a model that is still too dark) is subtracted. An exposure moves all blocks
/// of an image alike; an error of geometry or a highlight moves some. So the variance between images, less the part
/// that the scatter within them accounts for, is that of exposure and white balance. `stops` is its root, root mean
/// square over the channels. Masked and transparent pixels do not count.
PhotometricVariation measure_variation(Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                                       const std::function<std::shared_ptr<const ViewImage>(std::size_t)>& image);

/// The position at which --ppisp auto decides, and the least iterations before it. It is late enough for a rough scene,
/// and early enough that colour does not depend on the view much (degree 1 begins here).
inline constexpr double kPhotometricDecision = 1000;
inline constexpr std::int64_t kLeastIterations = 500;

/// The standard deviation of the exposures, in stops, above which view dependence waits. It lies between scenes that
/// need no waiting (bonsai at 200 pixels: 0.10) and those that lose without it (builtin:exposure: 0.21 after 1000
/// iterations, 0.4 after 4000).
inline constexpr double kSpreadThatHolds = 0.15;
/// The position from which on colours depend on the view in any case.
inline constexpr double kLongestHold = 10000;

/// The decision of --ppisp auto.
struct PhotometricDecision {
    bool on = false;
    PhotometricVariation variation;
};
/// Describes a decision, e.g. "on: images vary by 0.550 stops, threshold 0.075".
std::string describe(const PhotometricDecision& decision);

/// Returns the rate of PPISP's parameters `distance` positions after they began: `rate` after a slow start, falling by
/// a factor of 100 in 30000 (docs/math/ppisp.md#optimizer). The distance is negative where the schedule of a later
/// segment begins before PPISP did; the rate is then the first.
double ppisp_rate(double rate, double distance);
/// The learning rate of the controllers' weights.
inline constexpr double kControllerRate = 0.001;

/// PPISP in a run: off, on, decided by the images, or taken from another run. A new run begins with initial_state(), a
/// resumed one with resume(). decide() precedes every step, whose request apply() completes. Controllers come after the
/// last change of the Gaussians: add_controllers(), then apply_controller() for each of their steps.
class Photometric {
  public:
    /// Reads options.ppisp_from and matches it with the training images by name. Throws DataError if an image or camera
    /// has no counterpart there, UsageError if only one of the two runs uses EXIF. Both arguments must outlive the
    /// object.
    Photometric(const TrainOptions& options, const Scene& scene);

    /// Returns the state with which a new run begins; inactive if PPISP is off or not yet decided.
    const PpispState& initial_state() const { return initial_; }

    /// Continues a run at `moment`. If PPISP is on but the checkpoint has none, PPISP begins there.
    /// Throws UsageError for a checkpoint with PPISP when it is off, DataError for one with other numbers of images or
    /// cameras.
    void resume(Gaussians& state, const ScheduleMoment& moment);

    /// Decides before the step at `moment` if auto is due, and gives the backend its first state. Returns nothing if
    /// no decision was due.
    std::optional<PhotometricDecision> decide(
        Backend& backend, const ScheduleMoment& moment, const Vec3<float>& background,
        const std::function<std::shared_ptr<const ViewImage>(std::size_t)>& image);

    /// Returns true if colours should not yet depend on the view: the exposures found so far differ by more than
    /// kSpreadThatHolds, and the first third of the run is not over. View dependence would otherwise absorb some of the
    /// exposure for good.
    bool holds_view_dependence(Backend& backend, const ScheduleMoment& moment);

    /// Corrects training image `view` by its own values.
    void apply(std::size_t view, const ScheduleMoment& moment, StepRequest& request) const;

    /// Returns true if controllers are to be trained when the Gaussians are done.
    bool trains_controllers() const { return active_ && !frozen_ && options_.controller_iterations != 0; }
    void add_controllers(Backend& backend) const;
    /// Corrects training image `view` by its camera's controller.
    void apply_controller(std::size_t view, StepRequest& request) const;

    bool active() const { return active_; }
    /// Logs how well exposures agree with EXIF, if images have it.
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
    const double longest_hold_;  ///< position from which on colours depend on the view in any case
    const Scene& scene_;
    PpispFile file_;  ///< the fields of ppisp.json besides the numbers
    PpispState initial_;
    bool active_ = false, frozen_ = false, held_ = false;
    double first_ = 0;  ///< position of PPISP's first step
};

}  // namespace gs
