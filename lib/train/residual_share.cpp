// SPDX-License-Identifier: Apache-2.0
// Removes residuals in the order of their value.
#include "lib/train/residual_share.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>

#include "kernels/base/error.h"
#include "lib/model/appearance_spec.h"

namespace gs {
namespace {

constexpr int kNumStages = int(std::size(kResidualStages));
/// The part of the tolerance that the immediate loss may use before the search ends; the earlier stages have used some,
/// too.
constexpr double kPartAtOnce = 0.25;
/// The share of residuals that each further step of the search keeps.
constexpr double kShareStep = 0.9;
/// The largest number of views on which the search measures, enough for a hundredth of a decibel.
constexpr std::size_t kMostViews = 32;
/// The largest number of views that rank residuals before the last stage. A few views suffice to find the least
/// valuable residuals, since later stages rank again. From the last stage on all views are used: a Gaussian that none
/// of a few views shows would get the value 0, and its loss could no longer be recovered.
constexpr std::size_t kFewViews = 64;

/// The rows ranked by the value of their residuals.
class Ranking {
  public:
    /// Of equal values the first row ranks first; NaN ranks last.
    Ranking(const std::vector<float>& worth, std::int64_t num_residuals) : ranks_(worth.size(), kNone) {
        std::vector<std::uint32_t> order(static_cast<std::size_t>(num_residuals));
        std::iota(order.begin(), order.end(), 0u);
        const auto value = [&](std::uint32_t i) { return std::isnan(worth[i]) ? -INFINITY : worth[i]; };
        std::stable_sort(order.begin(), order.end(),
                         [&](std::uint32_t a, std::uint32_t b) { return value(a) > value(b); });
        for (std::size_t k = 0; k < order.size(); ++k) ranks_[order[k]] = std::uint32_t(k);
    }
    /// Marks the `kept` best rows, and reorders the ranks as Backend::keep_residuals moves the rows.
    std::vector<std::uint8_t> keep(std::int64_t kept) {
        std::vector<std::uint8_t> marks;
        for (const std::uint32_t rank : ranks_) marks.push_back(rank < kept);
        std::stable_partition(ranks_.begin(), ranks_.end(), [&](std::uint32_t rank) { return rank < kept; });
        return marks;
    }

  private:
    static constexpr std::uint32_t kNone = 0xffffffff;
    std::vector<std::uint32_t> ranks_;
};

/// Reorders `values`, three per row, as Backend::keep_residuals moves the rows.
void move_rows(std::vector<float>& values, const std::vector<std::uint8_t>& marks) {
    std::vector<float> out;
    out.reserve(values.size());
    for (const std::uint8_t mark : {1, 0})
        for (std::size_t i = 0; i < marks.size(); ++i)
            if (marks[i] == mark) out.insert(out.end(), &values[3 * i], &values[3 * i] + 3);
    values.swap(out);
}

/// Returns the number of the last stage, from 1, that is due before the step at `moment`, or 0.
int stage_at(const ScheduleMoment& moment) {
    int due = 0;
    for (int k = 0; k < kNumStages; ++k)
        if (moment.before < kResidualStages[k] && moment.position >= kResidualStages[k]) due = k + 1;
    return due;
}

/// Returns half the squared error of each sampled view.
std::vector<double> view_errors(Backend& backend, std::size_t num_views, const StepSource& step_on) {
    const std::size_t sampled = std::min(num_views, kMostViews);
    std::vector<double> errors;
    for (std::size_t k = 0; k < sampled; ++k)
        errors.push_back(backend.half_squared_error(step_on(k * num_views / sampled)));
    return errors;
}

/// Returns the residual scores from at most `most` views, evenly spaced in the list.
ResidualScores scores_by_views(Backend& backend, std::size_t num_views, std::size_t most, const StepSource& step_on) {
    const std::size_t sampled = std::min(num_views, most);
    return backend.residual_scores(sampled, [&](std::size_t k) { return step_on(k * num_views / sampled); });
}

/// Returns the mean loss of PSNR in dB.
double mean_loss(const std::vector<double>& before, const std::vector<double>& after) {
    constexpr double kLeast = 1e-12;  // for views with zero error, or fully masked
    double sum = 0, count = 0;
    for (std::size_t k = 0; k < before.size(); ++k)
        if (std::isfinite(before[k]) && std::isfinite(after[k]))
            sum += 10 * std::log10(std::max(after[k], kLeast) / std::max(before[k], kLeast)), ++count;
    return count > 0 ? sum / count : 0;
}

}  // namespace

std::optional<double> wanted_residual_share(const AppearanceOptions& options, const AppearanceSpec& appearance) {
    const int base = group_width(Group::kBase, appearance), residual = group_width(Group::kResidual, appearance);
    if (options.appearance_bytes) {
        const double floats = *options.appearance_bytes / double(sizeof(float));
        if (floats < base)
            throw UsageError(fmt::format("option appearance-bytes: {:g} is less than the {} bytes of a base colour",
                                         *options.appearance_bytes, base * sizeof(float)));
        return residual > 0 ? std::min(1.0, (floats - base) / residual) : 1;
    }
    if (residual == 0) return 1;
    return options.appearance_share;
}

ResidualShare::ResidualShare(const AppearanceOptions& options, const AppearanceSpec& appearance, const Scene& scene)
    : tolerance_(options.auto_tolerance), scene_(scene), share_(wanted_residual_share(options, appearance)) {}

std::optional<ResidualChange> ResidualShare::before_step(Backend& backend, const ScheduleMoment& moment,
                                                         const StepSource& step_on) const {
    const int stage = share_ == 1 ? 0 : stage_at(moment);
    if (stage == 0) return std::nullopt;
    const bool last = stage == kNumStages, searches = last && !share_;
    ResidualChange change;
    // Densification is over, so Gaussians that are invisible now stay so; the share does not count them.
    if (last) change.pruned = backend.prune_invisible();
    change.before = change.after = backend.num_residuals();
    const double share = std::pow(share_.value_or(kMostAutoShare), double(stage) / kNumStages);
    std::int64_t kept = std::llround(share * double(backend.count()));
    if (kept >= change.before) return change;
    const std::size_t num_views = scene_.train.size();
    const std::vector<double> errors = searches ? view_errors(backend, num_views, step_on) : std::vector<double>{};
    ResidualScores scores = scores_by_views(backend, num_views, last ? num_views : kFewViews, step_on);
    Ranking ranking(scores.worth, change.before);
    for (;; kept = std::int64_t(double(kept) * kShareStep)) {
        const std::vector<std::uint8_t> marks = ranking.keep(kept);
        backend.keep_residuals(marks, scores.mean_base);
        change.after = kept;
        if (!searches) return change;
        change.loss = mean_loss(errors, view_errors(backend, num_views, step_on));
        if (kept == 0 || !(change.loss < kPartAtOnce * tolerance_)) return change;
        move_rows(scores.mean_base, marks);
    }
}

std::size_t ResidualShare::views_at_end() const { return share_ == 1 ? 0 : scene_.train.size(); }

std::optional<ResidualChange> ResidualShare::at_end(Backend& backend, const StepSource& step_on) const {
    ResidualChange change;
    change.before = backend.num_residuals();
    change.after = std::llround(share_.value_or(kMostAutoShare) * double(backend.count()));
    if (share_ == 1 || change.after >= change.before) return std::nullopt;
    const ResidualScores scores = backend.residual_scores(scene_.train.size(), step_on);
    backend.keep_residuals(Ranking(scores.worth, change.before).keep(change.after), scores.mean_base);
    return change;
}

}  // namespace gs
