// SPDX-License-Identifier: Apache-2.0
// Computes the learning rates of all groups over time.
#include "lib/train/learning_rates.h"

#include <algorithm>
#include <cmath>

#include "lib/core/log.h"
#include "lib/core/options.h"

namespace gs {
namespace {

/// The camera spacing, in frame units, at which the rates that depend on it are unscaled.
constexpr double kNeutral = 0.3536;

/// The position from which rates fall to their final share, along a half cosine.
constexpr double kFallFrom = 20000;

/// The same for opacities if Gaussians lose their residuals. It is after the end of MCMC, so that unneeded Gaussians
/// have faded. Otherwise bonsai would end with a quarter more Gaussians
/// (docs/math/residuals.md#when-opacities-may-rest).
constexpr double kMixedOpacitiesFallFrom = 26000;

/// The pace above which a run counts as short: that of 10,000 iterations.
constexpr double kShortPace = 3;
/// The --feature-lr for which the models' rates are defined.
constexpr double kUsualFeatureRate = 0.0025;

/// The pace above which rates do not rise further: that of 100 iterations.
constexpr double kLongestPace = 300;

double fall_at(double position, double last, double from = kFallFrom) {
    if (position < from) return 1;
    const double t = std::min(1.0, (position - from) / (kReferenceIterations - from));
    return last + (1 - last) * 0.5 * (1 + std::cos(M_PI * t));
}

}  // namespace

LearningRates::LearningRates(const TrainOptions& options, const AppearanceSpec& appearance, const Scene& scene)
    : means_end_(options.position_lr_max_steps, kReferenceIterations),
      means_(Schedule::log_linear(options.position_lr_init * scene.extent, options.position_lr_final * scene.extent,
                                  means_end_.value())),
      scales_(Schedule::constant(options.scaling_lr)),
      rotations_(Schedule::constant(options.rotation_lr)),
      noise_(options.strategy == Strategy::kMcmc ? options.noise_lr : 0),
      feature_factor_(options.feature_lr / kUsualFeatureRate),
      residual_factor_(options.residual_rate * feature_factor_),
      final_rate_(options.final_rate),
      short_rates_(options.short_rates),
      base_travel_(options.base_travel),
      opacities_fall_from_(
          options.recipe != Recipe::kFrontier && options.takes_residuals_away() ? kMixedOpacitiesFallFrom : kFallFrom),
      extent_(float(scene.extent)),
      far_rate_(float(options.far_rate)) {
    const Eigen::Vector3f center = mean_camera_center(scene.train).cast<float>();
    center_ = {center.x(), center.y(), center.z()};
    spacing_ = camera_spacing(scene.train);
    opacities_ = Schedule::constant(opacity_rate(options.opacity_lr, spacing_));
    appearance_ = appearance_model(appearance.model).rates(appearance.max_degree, {spacing_, options.model_options});
}

void LearningRates::log(const TrainOptions& options) const {
    if (!options.opacity_lr)
        log_debug("opacity-lr auto: {:.3g} at camera spacing {:.3g}", opacities_.initial, spacing_);
    double residual = 0;
    for (const Schedule& column : appearance_.residual) residual = std::max(residual, column.initial);
    if (residual > 0) {
        log_debug("appearance {}: learning rates {:.3g} (base) and {:.3g} (residual{}); camera spacing {:.3g}",
                  options.appearance, feature_factor_ * appearance_.base.initial, residual_factor_ * residual,
                  appearance_.residual.size() > 1 ? ", fastest column" : "", spacing_);
    }
}

StepRates LearningRates::at(const ScheduleMoment& moment) const {
    StepRates rates;
    const double pace = std::min(moment.pace, kLongestPace);
    const double gain = pace > kShortPace ? std::pow(pace / kShortPace, short_rates_) : 1;
    const double t = moment.position + 1, means = gain * means_.at(means_end_.now(moment) + 1);
    const double fall = gain * fall_at(moment.position, final_rate_);
    const auto set = [&](Group group, const Schedule& schedule, double factor = 1) {
        rates.groups[static_cast<int>(group)] = fall * factor * schedule.at(t);
    };
    rates.groups[int(Group::kMean)] = means;
    set(Group::kScale, scales_);
    set(Group::kRotation, rotations_);
    rates.groups[int(Group::kOpacity)] =
        gain * fall_at(moment.position, final_rate_, opacities_fall_from_) * opacities_.at(t);
    const double base_rate = gain * feature_factor_ * appearance_.base.initial;
    const double least = base_travel_ * pace / kReferenceIterations;
    set(Group::kBase, appearance_.base, feature_factor_ * (base_rate > 0 ? std::max(1.0, least / base_rate) : 1));
    if (appearance_.residual.size() == 1) {
        set(Group::kResidual, appearance_.residual[0], residual_factor_);
    } else {
        for (const Schedule& column : appearance_.residual)
            rates.residuals.push_back(fall * residual_factor_ * column.at(t));
    }
    rates.center = center_, rates.extent = extent_, rates.far = far_rate_;
    rates.shared = fall * appearance_.shared.at(t);
    rates.noise = float(noise_ * means / gain);
    return rates;
}

double opacity_rate(const std::optional<double>& opacity_lr, double camera_spacing) {
    if (opacity_lr) return *opacity_lr;
    return std::clamp(0.025 * std::pow(kNeutral / camera_spacing, -0.6), 0.025, 0.05);
}

double camera_spacing(const std::vector<View>& views) {
    constexpr double kSmallest = 1e-6;
    const std::vector<Eigen::Vector3d> centers = usual_camera_centers(views);
    if (centers.size() < 2) return kNeutral;
    double sum = 0;
    std::vector<double> distances;
    for (const Eigen::Vector3d& a : centers) {
        distances.clear();
        for (const Eigen::Vector3d& b : centers)
            if (&a != &b) distances.push_back((a - b).norm());
        const std::size_t k = std::min<std::size_t>(3, distances.size());
        std::partial_sort(distances.begin(), distances.begin() + k, distances.end());
        double mean = 0;
        for (std::size_t i = 0; i < k; ++i) mean += distances[i] / double(k);
        sum += mean;
    }
    return std::max(sum / double(centers.size()), kSmallest);
}

}  // namespace gs
