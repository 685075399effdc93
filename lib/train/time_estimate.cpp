// SPDX-License-Identifier: Apache-2.0
// Adds up the costs of the steps to come, relative to those that were measured.
#include "lib/train/time_estimate.h"

#include <algorithm>
#include <cmath>

#include "lib/train/densification.h"
#include "lib/train/timeline.h"

namespace gs {
namespace {

/// The time of a pixel over that of a Gaussian in a step on the CPU. Measured on two cores without other load: 0.27 us
/// a Gaussian, and 0.10 us a pixel of bonsai at 200x133, 0.11 us of builtin:glossy.
constexpr double kPixelPerGaussian = 0.4;
/// The most steps that are looked at one by one. Those of a longer run stand for several.
constexpr std::int64_t kMostSamples = 30000;

}  // namespace

double estimate_seconds(const TrainOptions& options, const MeasuredSteps& steps, std::int64_t cap) {
    const DensificationWindow window(options);
    const auto cost = [&](const Moment& moment, double count) {
        const bool coarse = moment.position < options.coarse_until * kReferenceIterations;
        return count + kPixelPerGaussian * steps.pixels / (coarse ? 4 : 1);
    };
    const double measured_cost = cost(moment_at(options, steps.iteration), double(steps.num_gaussians));
    const std::int64_t stride = 1 + (options.iterations - 1) / kMostSamples;
    double count = double(steps.num_gaussians), total = 0;
    Moment last = moment_at(options, steps.iteration - 1);
    for (std::int64_t k = steps.iteration; k < options.iterations; k += stride) {
        Moment moment = moment_at(options, k);
        moment.before = last.position;
        if (options.strategy == Strategy::kMcmc && window.due(moment))
            count = std::max(count, std::min(double(cap), McmcParams{}.growth * count));
        total += cost(moment, count) * double(std::min(stride, options.iterations - k));
        last = moment;
    }
    return steps.seconds_per_iteration * total / measured_cost;
}

}  // namespace gs
