// SPDX-License-Identifier: Apache-2.0
// Measures render times, and removes Gaussians until the limits hold.
#include "lib/train/model_limits.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "kernels/base/error.h"
#include "lib/core/log.h"
#include "lib/core/quantities.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/resized.h"

namespace gs {
namespace {

/// The numbers of views and rounds of one measurement.
constexpr std::size_t kTimedViews = 3, kFrameViews = 9;
constexpr int kFrameRounds = 2;
/// The time of scoring a view relative to rendering it, with a margin, since frames take longer with more Gaussians.
constexpr double kScorePerFrame = 4;
/// The growth factor after which frames are measured again.
constexpr double kGrowth = 1.1;
/// The maximum number of pruning rounds for a frame limit, the share of the limit that they aim at, and the smallest
/// and largest share of Gaussians that one round removes: measured times scatter, and removed Gaussians do not return.
constexpr int kPruneRounds = 6;
constexpr double kAim = 0.98, kLeastPruned = 0.02, kMostPruned = 0.5;

}  // namespace

ModelLimits::ModelLimits(const LimitOptions& options, const Scene& scene, const Vec3<float>& background,
                         std::int64_t most_at_end)
    : options_(options),
      scene_(scene),
      background_(background),
      most_at_end_(most_at_end),
      frame_limit_(options.frame_limit ? options.frame_limit->seconds : 0) {}

std::vector<RenderRequest> ModelLimits::views() const {
    std::vector<RenderRequest> views(scene_.train.size());
    for (std::size_t k = 0; k < views.size(); ++k) {
        views[k].camera = camera_params(scene_.train[k].camera);
        views[k].background = background_;
    }
    return views;
}

double ModelLimits::view_seconds(Backend& backend, int factor) const {
    std::vector<RenderRequest> timed = views();
    timed.resize(std::min(timed.size(), kTimedViews));
    for (std::size_t k = 0; k < timed.size(); ++k)
        timed[k].camera = camera_params(reduced(scene_.train[k].camera, factor));
    return backend.time_frames(timed, 1);
}

double ModelLimits::coarse_ratio(Backend& backend, int factor) const {
    return factor == 1 ? 1 : std::max(1.0, view_seconds(backend) / view_seconds(backend, factor));
}

double ModelLimits::frame_seconds(Backend& backend) const {
    std::vector<RenderRequest> timed;
    const std::size_t all = scene_.train.size(), used = std::min(all, kFrameViews);
    for (std::size_t k = 0; k < used; ++k) {
        const Camera camera = with_size(scene_.train[k * all / used].camera, kFrameWidth, kFrameHeight);
        timed.push_back({.camera = camera_params(camera), .background = background_});
    }
    return backend.time_frames(timed, kFrameRounds);
}

std::int64_t ModelLimits::cap() const {
    if (most_at_end_ == 0) return options_.cap_max;
    return std::min(options_.cap_max, most_at_end_ + std::max<std::int64_t>(1, most_at_end_ / 10));
}

void ModelLimits::require_feasible(Backend& backend, const Gaussians& smallest) const {
    if (frame_limit_ == 0) return;
    backend.upload(smallest);
    const double least = frame_seconds(backend);
    if (least > kAim * frame_limit_)
        throw UsageError(
            fmt::format("option frame-limit: {}: a frame of 1280x720 with one Gaussian takes {:.2g} ms on this device",
                        options_.frame_limit->text(), 1e3 * least));
}

std::int64_t ModelLimits::most_now(Backend& backend) {
    if (frame_limit_ == 0) return cap();
    const std::int64_t count = backend.count();
    if (affordable_ == 0 || double(count) > kGrowth * double(measured_count_)) {
        measured_count_ = count;
        affordable_ = std::int64_t(double(count) * std::max(1.0, frame_limit_ / frame_seconds(backend)));
    }
    return std::min(cap(), affordable_);
}

double ModelLimits::seconds_to_prune(Backend& backend) const {
    if (most_at_end_ == 0 && frame_limit_ == 0) return 0;
    const double scores = kScorePerFrame * double(scene_.train.size()) * view_seconds(backend);
    if (frame_limit_ == 0) return scores;
    // Frames at the end take about the limit; one more round is the warm-up.
    const double frames = double(kFrameViews) * (kFrameRounds + 1) * frame_limit_;
    return kPruneRounds * (scores + frames) + frames;
}

void ModelLimits::prune_to(Backend& backend, std::int64_t most, const char* asks) const {
    const std::int64_t before = backend.count();
    // More than one round is needed only if the hundredth that a round always leaves is too much.
    for (std::int64_t count = before; count > most; count = backend.count()) {
        // prune_lowest_scores() removes floor(ratio (count - 1)) + 1 (docs/math/densification.md#pruning-by-score).
        const double ratio = (double(count - most) - 0.5) / double(std::max<std::int64_t>(1, count - 1));
        if (backend.prune_lowest_scores(views(), ratio) == 0) break;
    }
    if (before > backend.count())
        log_info("{}: {} of {} Gaussians removed, those with the lowest scores", asks, before - backend.count(),
                 before);
}

void ModelLimits::prune(Backend& backend) const {
    if (most_at_end_ > 0) prune_to(backend, most_at_end_, "size limit");
    if (frame_limit_ == 0) return;
    double earlier_count = 0, earlier_seconds = 0;
    for (int round = 0; backend.count() > 1; ++round) {
        const double count = double(backend.count()), seconds = frame_seconds(backend);
        if (seconds <= frame_limit_) return;
        if (round == kPruneRounds) {
            log_warning("frame limit {}: {} Gaussians still take {:.3g} ms", options_.frame_limit->text(),
                        backend.count(), 1e3 * seconds);
            return;
        }
        // The first estimate takes the time as proportional to the number; later ones use the line through two
        // measurements.
        double most = count * kAim * frame_limit_ / seconds;
        if (earlier_seconds > seconds)
            most = count - (seconds - kAim * frame_limit_) * (earlier_count - count) / (earlier_seconds - seconds);
        earlier_count = count, earlier_seconds = seconds;
        prune_to(backend, std::llround(std::clamp(most, (1 - kMostPruned) * count, (1 - kLeastPruned) * count)),
                 "frame limit");
    }
}

}  // namespace gs
