// SPDX-License-Identifier: Apache-2.0
// Decides on the next model to train.
#include "lib/train/target_search.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace gs {
namespace {

/// The minimum number of steps of the first training, and its rounds through the views. Fewer rounds predict little,
/// even with the gain from doubling them: after 9 rounds bonsai was judged unable to reach 31 dB, and lego had six
/// times as many Gaussians as it needs for 32 dB.
constexpr std::int64_t kFirstSteps = 1000, kFirstRounds = 30;
/// The largest number of Gaussians per step of a training. Under time limits bonsai had 28 to 45 and garden 48 to 79.
constexpr std::int64_t kGaussiansPerStep = 50;
/// The positions from which the schedules restart when a training is prolonged and when a smaller model recovers.
constexpr double kGrowFrom = 10000, kShrinkFrom = 20000;
/// The number of steps in which a smaller model recovers, as a share of the steps until the target was reached, and its
/// bounds.
constexpr double kRecovery = 0.125;
constexpr std::int64_t kLeastRecovery = 200, kMostRecovery = 2000;
/// The largest gain from doubling the steps, relative to the previous doubling, and the margin by which a training may
/// exceed the estimate, dB.
constexpr double kNextGain = 0.8, kHope = 0.3;
/// The margin above the target within which a model counts as small enough, dB.
constexpr double kNear = 0.1;
/// The ratio of sizes below which a smaller model that missed the target is ignored: the larger model has had more
/// steps.
constexpr double kSameSize = 1.05;
/// The smallest loss of PSNR assumed for halving a model, dB, and the loss assumed until a model has missed the target.
constexpr double kLeastHalving = 0.3, kHalving = 0.8;
constexpr int kMostShrinks = 12;

}  // namespace

TargetSearch::TargetSearch(double target, std::int64_t views, std::int64_t most_steps, std::int64_t cap)
    : target_(target),
      most_steps_(most_steps),
      first_steps_(std::min(most_steps, std::max(kFirstSteps, kFirstRounds * views))),
      cap_(cap) {}

std::int64_t TargetSearch::most_gaussians(std::int64_t steps, std::int64_t count) const {
    return std::max(count, std::min(cap_, kGaussiansPerStep * steps));
}

ScheduleSegment TargetSearch::first(std::int64_t steps, std::int64_t count) const {
    return {.steps = std::max<std::int64_t>(0, first_steps_ - steps),
            .from = kReferenceIterations * double(std::min(steps, first_steps_)) / double(first_steps_),
            .most_gaussians = most_gaussians(first_steps_, count)};
}

TargetStep TargetSearch::next(const MeasuredModel& measured) {
    tries_.push_back(measured);
    if (!good_ && measured.psnr < target_) return grow(measured);
    if (!good_) grown_steps_ = measured.steps;
    return shrink(measured);
}

TargetStep TargetSearch::grow(const MeasuredModel& measured) {
    const double doublings = std::log2(double(most_steps_) / double(std::max<std::int64_t>(1, measured.steps)));
    if (measured.steps >= most_steps_) {
        why_ = fmt::format("{} iterations are all that --iterations allows", most_steps_);
        return {};
    }
    if (tries_.size() > 1) {
        const double gain = std::max(0.0, measured.psnr - tries_[tries_.size() - 2].psnr);
        // A geometric series: every doubling gains kNextGain times the gain of the previous one.
        const double estimate =
            measured.psnr + gain * kNextGain * (1 - std::pow(kNextGain, doublings)) / (1 - kNextGain);
        if (estimate + kHope < target_) {
            estimate_ = estimate;
            why_ = fmt::format("{} iterations would reach about {:.1f} dB", most_steps_, estimate);
            return {};
        }
    }
    const std::int64_t steps = std::clamp<std::int64_t>(measured.steps, 1, most_steps_ - measured.steps);
    return {.segment = {.steps = steps,
                        .from = kGrowFrom,
                        .most_gaussians = most_gaussians(measured.steps + steps, measured.count)}};
}

TargetStep TargetSearch::shrink(const MeasuredModel& measured) {
    TargetStep step;
    if (measured.psnr >= target_) {
        good_ = measured;
        step.keep = true;
    } else {
        bad_ = measured;
        step.restore = true;
    }
    const double spare = good_->psnr - target_, count = double(good_->count);
    if (bad_ && count < kSameSize * double(bad_->count)) bad_.reset();
    if (bad_) halving_ = std::max(kLeastHalving, (good_->psnr - bad_->psnr) / std::log2(count / double(bad_->count)));
    const auto shrinks =
        std::count_if(tries_.begin(), tries_.end(), [this](const MeasuredModel& t) { return t.steps > grown_steps_; });
    if (spare <= kNear || good_->count <= 1 || shrinks >= kMostShrinks) return step;
    double smaller = std::exp2(-std::min(1.0, spare / halving_.value_or(kHalving)));
    if (bad_) {  // between the two models, as if PSNR were linear in the logarithm of the size
        const double share = std::clamp((spare - 0.5 * kNear) / (good_->psnr - bad_->psnr), 0.3, 0.85);
        smaller = std::pow(double(bad_->count) / count, share);
    }
    step.prune_to = std::clamp<std::int64_t>(std::llround(count * smaller), 1, good_->count - 1);
    step.segment = {.steps = std::clamp(std::int64_t(kRecovery * double(grown_steps_)), kLeastRecovery, kMostRecovery),
                    .from = kShrinkFrom,
                    .most_gaussians = step.prune_to};
    return step;
}

TargetOutcome TargetSearch::outcome() const {
    const MeasuredModel last = good_ ? *good_ : tries_.empty() ? MeasuredModel{} : tries_.back();
    const std::string verdict =
        good_ ? fmt::format("target {:g} dB: reached with {} Gaussians, {:.2f} dB on the held-out views", target_,
                            last.count, last.psnr)
              : fmt::format("target {:g} dB: not reached, {:.2f} dB on the held-out views after {} iterations: {}",
                            target_, last.psnr, last.steps, why_);
    return {.reached = good_.has_value(),
            .standard_error = last.standard_error,
            .count = last.count,
            .psnr = last.psnr,
            .estimate = estimate_,
            .measurements = std::int64_t(tries_.size()),
            .verdict = verdict};
}

}  // namespace gs
