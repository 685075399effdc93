// SPDX-License-Identifier: Apache-2.0
// Takes residuals away by what they are worth.
#include "lib/train/residual_share.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "kernels/core/error.h"
#include "lib/model/appearance_spec.h"

namespace gs {
namespace {

/// Each step of the search for a share keeps this much of the last one.
constexpr double kShareStep = 0.9;
/// The views on which the search measures: enough for a hundredth of a decibel.
constexpr std::size_t kMostViews = 32;

/// Marks the `kept` highest worths of the first `num_residuals` rows, the first rows of equal ones; what is no number
/// has the lowest.
std::vector<std::uint8_t> marks_of_best(const std::vector<float>& worth, std::int64_t num_residuals,
                                        std::int64_t kept) {
    std::vector<std::uint32_t> order(static_cast<std::size_t>(num_residuals));
    std::iota(order.begin(), order.end(), 0u);
    const auto value = [&](std::uint32_t i) { return std::isnan(worth[i]) ? -INFINITY : worth[i]; };
    std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return value(a) > value(b); });
    std::vector<std::uint8_t> marks(worth.size(), 0);
    for (std::int64_t k = 0; k < kept; ++k) marks[order[std::size_t(k)]] = 1;
    return marks;
}

/// Moves what belongs to rows as Backend::keep_residuals moves these: `columns` values a row.
void move_rows(std::vector<float>& values, int columns, const std::vector<std::uint8_t>& marks) {
    std::vector<float> out;
    out.reserve(values.size());
    for (const std::uint8_t mark : {1, 0})
        for (std::size_t i = 0; i < marks.size(); ++i)
            if (marks[i] == mark)
                out.insert(out.end(), values.begin() + std::ptrdiff_t(i) * columns,
                           values.begin() + std::ptrdiff_t(i + 1) * columns);
    values.swap(out);
}

/// Returns half the squared error of each of the sampled views.
std::vector<double> view_errors(Backend& backend, std::size_t num_views, const StepSource& step_on) {
    const std::size_t sampled = std::min(num_views, kMostViews);
    std::vector<double> errors;
    for (std::size_t k = 0; k < sampled; ++k) errors.push_back(backend.squared_error(step_on(k * num_views / sampled)));
    return errors;
}

/// Returns by how many decibels the PSNR fell, on average.
double mean_loss(const std::vector<double>& before, const std::vector<double>& after) {
    constexpr double kLeast = 1e-12;  // of views that are met exactly, or masked
    double sum = 0, count = 0;
    for (std::size_t k = 0; k < before.size(); ++k)
        if (std::isfinite(before[k]) && std::isfinite(after[k]))
            sum += 10 * std::log10(std::max(after[k], kLeast) / std::max(before[k], kLeast)), ++count;
    return count > 0 ? sum / count : 0;
}

}  // namespace

std::optional<double> wanted_residual_share(const TrainOptions& options, const AppearanceSpec& appearance) {
    const int base = group_width(Group::kBase, appearance), residual = group_width(Group::kResidual, appearance);
    if (options.appearance_bytes > 0) {
        const double floats = options.appearance_bytes / double(sizeof(float));
        if (floats < base)
            throw UsageError(fmt::format("option appearance-bytes: {:g} is less than the {} bytes of a base colour",
                                         options.appearance_bytes, base * sizeof(float)));
        return residual > 0 ? std::min(1.0, (floats - base) / residual) : 1;
    }
    if (residual == 0) return 1;
    if (std::isnan(options.appearance_share)) return std::nullopt;
    return options.appearance_share;
}

ResidualShare::ResidualShare(const TrainOptions& options, const AppearanceSpec& appearance, const Scene& scene)
    : options_(options), scene_(scene), share_(wanted_residual_share(options, appearance)) {}

std::optional<ResidualChange> ResidualShare::before_step(Backend& backend, const Moment& moment,
                                                         const StepSource& step_on) const {
    if (share_ == 1 || moment.before >= kResidualChoice || moment.position < kResidualChoice) return std::nullopt;
    ResidualChange change{.before = backend.num_residuals()};
    change.after = change.before;
    const std::int64_t wanted = share_ ? std::llround(*share_ * double(backend.count())) : 0;
    if (wanted >= change.before) return change;
    const ResidualScores scores = backend.residual_scores(scene_.train.size(), step_on);
    if (!share_) return choose_by_loss(backend, scores, step_on);
    backend.keep_residuals(marks_of_best(scores.worth, change.before, wanted), scores.mean_base);
    change.after = backend.num_residuals();
    return change;
}

ResidualChange ResidualShare::choose_by_loss(Backend& backend, ResidualScores scores, const StepSource& step_on) const {
    ResidualChange change{.before = backend.num_residuals()};
    change.after = change.before;
    const Gaussians whole = backend.download(true);
    const ResidualScores all = scores;
    const std::vector<double> before = view_errors(backend, scene_.train.size(), step_on);
    for (auto kept = std::int64_t(double(change.before) * kShareStep);;
         kept = std::int64_t(double(kept) * kShareStep)) {
        const std::vector<std::uint8_t> marks = marks_of_best(scores.worth, backend.num_residuals(), kept);
        backend.keep_residuals(marks, scores.mean_base);
        const double loss = mean_loss(before, view_errors(backend, scene_.train.size(), step_on));
        if (!(loss <= options_.auto_tolerance)) break;
        change.after = kept, change.loss = loss;
        if (kept == 0) return change;
        move_rows(scores.worth, 1, marks), move_rows(scores.mean_base, 3, marks);
    }
    backend.upload(whole);
    if (change.after < change.before)
        backend.keep_residuals(marks_of_best(all.worth, change.before, change.after), all.mean_base);
    return change;
}

}  // namespace gs
