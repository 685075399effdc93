// SPDX-License-Identifier: Apache-2.0
// Computes the position of the next step, and divides the time of a run.
#include "lib/train/training_schedule.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "kernels/base/error.h"
#include "lib/core/quantities.h"

namespace gs {
namespace {

/// The minimum number of steps for an estimate of the time per step.
constexpr std::int64_t kFewestSteps = 5;

/// The number of rounds through all views beyond which more steps help less than more Gaussians, and the largest number
/// of steps required in this way, two thirds of the reference's (docs/lab/settings.md#the-frontier).
constexpr double kWantedRounds = 70, kMostWantedSteps = 20000;
/// The reduction factor of images in the first part of a training.
constexpr int kCoarse = 2;
/// The time of a step relative to rendering its frame, which has no backward pass and no update.
constexpr double kStepPerFrame = 3;
/// The number of first steps, whose time does not represent that of later steps.
constexpr std::int64_t kWarmUpSteps = 10;
/// The minimum time for steps that a time limit must leave, in seconds.
constexpr double kLeastSeconds = 0.1;
/// The share of a time limit for the controllers if their number of iterations is not named, and their largest share if
/// it is.
constexpr double kControllerShare = 1.0 / 7, kMostControllerShare = 0.5;

}  // namespace

void TimeBudget::start(const TimeCosts& costs, std::int64_t iteration) {
    costs_ = costs;
    start_ = clock_();
    marked_seconds_ = elapsed(), marked_iteration_ = iteration;
}

double TimeBudget::for_steps(std::int64_t count) const {
    return limit_ - kept_back_ - costs_.at_end - kSavingOverhead - costs_.saving_per_gaussian * double(count);
}

double TimeBudget::progress(std::int64_t count) const {
    const double all = for_steps(count);
    return all > 0 ? std::clamp(elapsed() / all, 0.0, 1.0) : 1;
}

std::int64_t TimeBudget::affordable(std::int64_t count, std::int64_t iteration, bool coarse) {
    const std::int64_t steps = iteration - marked_iteration_;
    if (steps < kFewestSteps) return count;
    const double now = elapsed(), step = (now - marked_seconds_) / double(steps) * (coarse ? costs_.coarse_ratio : 1),
                 left = for_steps(count) - now, wanted = wanted_steps_ * (1 - progress(count));
    marked_seconds_ = now, marked_iteration_ = iteration;
    if (wanted < 1) return count;
    return std::int64_t(std::clamp(double(count) * left / (step * wanted), 1.0, 1e12));
}

std::int64_t wanted_steps(std::size_t num_views) {
    return std::int64_t(std::min(kWantedRounds * double(num_views), kMostWantedSteps));
}

TrainingSchedule::TrainingSchedule(const ScheduleOptions& options, std::size_t num_views)
    : options_(options),
      limit_(options.time_limit ? options.time_limit->seconds : 0),
      wanted_steps_(gs::wanted_steps(num_views)) {
    if (!limits_time()) resume(0, 0);
}

void TrainingSchedule::resume(std::int64_t iteration, double used) {
    used_ = used;
    moment_ = moment_at(options_, iteration);
    if (limits_time()) {  // approximately the position that start() will set
        const double position = kReferenceIterations * std::min(1.0, used / limit_);
        moment_ = {iteration, position, position - 1};
    }
    finished_ = !limits_time() && iteration >= options_.iterations;
}

std::int64_t TrainingSchedule::affordable_start(std::int64_t count, double frame_seconds) const {
    return std::int64_t(double(count) *
                        std::min(1.0, limit_ / (kStepPerFrame * frame_seconds * double(wanted_steps_))));
}

void TrainingSchedule::start(const TimeCosts& costs, std::int64_t count) {
    budget_.emplace(limit_, used_, wanted_steps_);
    budget_->start(costs, moment_.iteration);
    const double least = used_ + limit_ - budget_->for_steps(count) + kLeastSeconds;
    if (moment_.iteration == 0 && limit_ < least)
        throw UsageError(fmt::format(
            "option time-limit: {} is too short: saving {} Gaussians alone takes {:.2f} s here; the "
            "shortest limit is {:g}s",
            options_.time_limit->text(), count, limit_ - budget_->for_steps(count), std::ceil(20 * least) / 20));
    first_iteration_ = moment_.iteration;
    const double position = kReferenceIterations * budget_->progress(count);
    moment_ = {moment_.iteration, position, position - 1};
    finished_ = position >= kReferenceIterations;
}

void TrainingSchedule::begin(const ScheduleSegment& segment, std::int64_t count) {
    segment_ = segment;
    segment_iteration_ = moment_.iteration;
    segment_start_ = budget_ ? budget_->elapsed() : 0;
    const double pace = (kReferenceIterations - segment.from) / double(std::max<std::int64_t>(1, segment.steps));
    moment_ = {moment_.iteration, segment.from, segment.from - pace, pace};
    finished_ = segment.steps <= 0 || (budget_ && segment_start_ >= budget_->for_steps(count));
}

void TrainingSchedule::advance_segment(std::int64_t count) {
    const std::int64_t done = moment_.iteration + 1 - segment_iteration_;
    double progress = double(done) / double(segment_->steps);
    if (budget_) {
        const double left = budget_->for_steps(count) - segment_start_;
        progress = std::max(progress, left > 0 ? (budget_->elapsed() - segment_start_) / left : 1.0);
    }
    const double position = segment_->from + (kReferenceIterations - segment_->from) * std::min(progress, 1.0);
    moment_ = {moment_.iteration + 1, std::max(moment_.position, position), moment_.position, moment_.pace};
    finished_ = progress >= 1;
}

void TrainingSchedule::advance(std::int64_t count, std::int64_t views) {
    const double before = moment_.position;
    for (std::int64_t k = 0; k < views; ++k) advance_one(count);
    moment_.before = before;
    if (limits_time() && !segment_) finished_ = ends_here();
}

void TrainingSchedule::advance_one(std::int64_t count) {
    if (segment_) {
        advance_segment(count);
        return;
    }
    if (!limits_time()) {
        moment_ = moment_at(options_, moment_.iteration + 1);
        finished_ = moment_.iteration >= options_.iterations;
        return;
    }
    moment_ = next_moment(moment_, budget_->progress(count));
    const std::int64_t steps = moment_.iteration - first_iteration_;
    if (steps == kWarmUpSteps) warm_position_ = moment_.position;
    if (steps >= 2 * kWarmUpSteps) moment_.pace = (moment_.position - warm_position_) / double(steps - kWarmUpSteps);
    finished_ = ends_here();
}

bool TrainingSchedule::ends_here() const {
    // A step may take long on a CPU: stop at the step whose end is nearest to the limit.
    return moment_.position + 0.5 * moment_.stride() >= kReferenceIterations;
}

std::int64_t TrainingSchedule::expected_iterations() const {
    if (limits_time()) return finished_ ? moment_.iteration : 0;
    return segment_ ? segment_iteration_ + segment_->steps : options_.iterations;
}

std::optional<double> TrainingSchedule::seconds_left() const {
    if (!limits_time()) return std::nullopt;
    return budget_ ? std::max(0.0, budget_->limit() - budget_->elapsed()) : limit_;
}

int TrainingSchedule::reduction() const {
    const double done = limits_time() || segment_ ? moment_.position / kReferenceIterations
                                                  : double(moment_.iteration) / double(options_.iterations);
    return done < options_.coarse_until ? kCoarse : 1;
}

void TrainingSchedule::keep_back_for_controllers(const std::optional<std::int64_t>& iterations) {
    if (!budget_) return;
    const double mean_step = budget_->elapsed() / double(std::max<std::int64_t>(1, moment_.iteration));
    budget_->keep_back(iterations ? std::min(kMostControllerShare * limit_, double(*iterations) * mean_step)
                                  : kControllerShare * limit_);
}

std::int64_t TrainingSchedule::most_gaussians(std::int64_t count, std::int64_t cap) {
    if (segment_) return std::min(cap, std::max(count, segment_->most_gaussians));
    if (!budget_) return cap;
    return std::min(cap, std::max(count, budget_->affordable(count, moment_.iteration, reduction() > 1)));
}

}  // namespace gs
