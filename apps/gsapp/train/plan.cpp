// SPDX-License-Identifier: Apache-2.0
// Splits file sizes into parts, evaluates curves fitted to measured losses, and describes a plan in words.
#include "apps/gsapp/train/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/quantities.h"
#include "lib/export/ngsplat.h"
#include "lib/export/pack_scene.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/ply.h"
#include "lib/train/residual_share.h"
#include "lib/train/training_schedule.h"

namespace gs {
namespace {

/// Bytes reserved for texts whose length is not known yet: the trailer of a scene, the header of a PLY.
constexpr std::int64_t kTrailerBytes = 1024, kPlyHeaderBytes = 4096;
/// Bytes per Gaussian in a .splat file.
constexpr std::int64_t kSplatBytes = 32;

/// Packs a model of one Gaussian, with as many cameras as the scene's export has.
PackedScene packed_sample(const TrainOptions& options, const Scene& scene) {
    PackedScene packed = packed_sample(appearance_spec(options));
    packed.cameras.resize(scene.test.size());
    if (options.ppisp != PpispMode::kOff) packed.ppisp.emplace().views.resize(scene.test.size());
    return packed;
}

/// Share of a size limit below which a file counts as too small.
constexpr double kLeastUse = 0.95;

std::string megabytes(std::int64_t bytes) { return fmt::format("{:.3g} MB", 1e-6 * double(bytes)); }

/// Pixels of the training images needed to determine one Gaussian, which has some 60 parameters; a pixel has three
/// values.
constexpr std::int64_t kPixelsPerGaussian = 20;

/// Sets the number of Gaussians of a full run: --cap-max, or fewer if the images cannot determine so many.
void note_full_count(TrainingPlan& plan, const TrainOptions& options, const Scene& scene) {
    std::int64_t pixels = 0;
    for (const View& view : scene.train) pixels += std::int64_t(view.camera.width) * view.camera.height;
    const std::int64_t by_images = std::max<std::int64_t>(1, pixels / kPixelsPerGaussian);
    plan.full_count = std::min(by_images, options.cap_max);
    plan.full_count_reason = by_images < options.cap_max
                                 ? fmt::format("one for every {} pixels of the training images", kPixelsPerGaussian)
                                 : "--cap-max";
}

/// Returns the loss of a training with this number of iterations; empty if the length is found by a search, or if no
/// losses were measured for the recipe.
std::optional<double> loss_of_iterations(const TrainingPlan& plan, const TrainOptions& options,
                                         std::int64_t iterations) {
    if (options.recipe != Recipe::kFrontier || options.target_psnr || iterations == 0 || plan.num_views == 0)
        return std::nullopt;
    return loss_of_length(double(iterations) / double(plan.num_views));
}

/// Describes the loss from a length, and the option that reduces it: "about 0.8 dB below a training of any length (a
/// longer --time-limit comes closer)".
std::string loss_words(double loss, const TrainOptions& options) {
    const bool short_preset = options.preset == Preset::kFast || options.preset == Preset::kBalanced;
    const char* option = options.time_limit                                      ? "a longer --time-limit comes"
                         : short_preset && !options.named.contains("iterations") ? "--preset best comes"
                                                                                 : "more --iterations come";
    return fmt::format("{} below a training of any length ({} closer)", about(loss), option);
}

/// Returns the option that would allow more than `count` Gaussians.
const char* limit_of_count(const TrainingPlan& plan, const TrainOptions& options, std::int64_t count) {
    if (plan.size && double(count) > kLeastUse * double(plan.size->most_gaussians)) return "a larger --size-limit";
    if (options.frame_limit) return "a longer --frame-limit";
    return !options.time_limit ? "a training of more --iterations" : "a longer --time-limit";
}

void plan_the_time(TrainingPlan& plan, const TrainOptions& options) {
    const bool limited = options.time_limit.has_value();
    const std::int64_t iterations = limited ? wanted_steps(plan.num_views) : options.iterations;
    const std::optional<double> loss = loss_of_iterations(plan, options, iterations);
    if (loss) plan.estimate = "by estimate " + loss_words(*loss, options);
    const std::string cost = loss ? ", " + plan.estimate : "";
    if (limited) {
        const double seconds = options.time_limit->seconds;
        plan.lines.push_back(fmt::format(
            "time: {} from the first step to the saved model; at most {} Gaussians, as far as that leaves {} "
            "iterations{}",
            duration_text(seconds), options.cap_max, iterations, cost));
        plan.json["time"] = {{"limit_seconds", seconds}};
    } else {
        plan.lines.push_back(
            fmt::format("time: no limit, {}{} iterations{}", options.target_psnr ? "at most " : "", iterations, cost));
        plan.json["iterations"] = iterations;
    }
    if (loss) plan.json["estimated_loss"]["length"]["planned"] = *loss;
}

void plan_the_size(TrainingPlan& plan, const TrainOptions& options, const Scene& scene) {
    plan.size = plan_size(options, scene);
    const SizePlan& size = *plan.size;
    const std::int64_t most = std::min(size.most_gaussians, options.cap_max);
    const double loss = loss_of_count(most, plan.full_count);
    const std::string cost =
        loss > 0 ? fmt::format(
                       ", by estimate {} below {} Gaussians ({}) if the scene has detail for so many (a larger "
                       "--size-limit admits more)",
                       about(loss), plan.full_count, plan.full_count_reason)
                 : "";
    plan.lines.push_back(fmt::format("size: at most {} as {}: {} Gaussians of {:.4g} bytes with {}{}",
                                     options.size_limit->text(), word(options.size_of), most, size.mean_bytes(),
                                     options.appearance, cost));
    plan.json["estimated_loss"]["count"]["planned"] = loss;
    if (double(size.bytes(most)) < kLeastUse * double(size.limit))
        plan.lines.push_back(
            fmt::format("size: the largest file within the limit has {}: {}", megabytes(size.bytes(most)),
                        most < size.most_gaussians ? "--cap-max ends there"
                                                   : fmt::format("the file grows by {} Gaussians", size.unit)));
    plan.json["size"] = {{"limit_bytes", size.limit},
                         {"of", word(options.size_of)},
                         {"appearance", options.appearance},
                         {"bytes_per_gaussian", size.mean_bytes()},
                         {"most_gaussians", most}};
}

/// Logs and stores the estimated losses from the length and from the number of Gaussians.
void note_loss(TrainingPlan& plan, const TrainOptions& options, const TrainSummary& summary) {
    const std::optional<double> length = loss_of_iterations(plan, options, summary.iterations);
    if (!length || summary.num_gaussians == 0) return;
    const double count = loss_of_count(summary.num_gaussians, plan.full_count);
    log_info("estimate: these {} iterations are {}", summary.iterations, loss_words(*length, options));
    if (summary.num_gaussians < plan.full_count)
        log_info("estimate: these {} Gaussians are {} below {} ({}); {} lets more grow", summary.num_gaussians,
                 about(count), plan.full_count, plan.full_count_reason,
                 limit_of_count(plan, options, summary.num_gaussians));
    plan.json["estimated_loss"]["length"]["final"] = *length;
    plan.json["estimated_loss"]["count"]["final"] = count;
}

}  // namespace

// Fitted curves; their errors are in docs/lab/limits.md#what-the-plan-estimates.

double loss_of_length(double rounds) { return 0.8 * std::pow(70 / rounds, 1.3); }

double loss_of_count(std::int64_t count, std::int64_t most) {
    const double halvings = std::max(0.0, std::log2(double(most) / double(count)));
    return (0.15 + 0.13 * halvings) * halvings;
}

std::string about(double loss) {
    constexpr double kMost = 10;  // beyond all measurements
    if (loss < 0.1) return "less than 0.1 dB";
    return loss > kMost ? fmt::format("more than {:g} dB", kMost) : fmt::format("about {:.1f} dB", loss);
}

std::int64_t SizePlan::bytes(std::int64_t count) const {
    const auto padded = [&](std::int64_t n) { return (n + unit - 1) / unit * unit; };
    const std::int64_t header = share < 1 && per_residual > 0 ? sizeof(std::uint32_t) : 0;  // number of residuals
    return fixed + header + padded(count) * per_gaussian + padded(std::llround(share * double(count))) * per_residual;
}

SizePlan plan_size(const TrainOptions& options, const Scene& scene) {
    SizePlan plan{.limit = std::int64_t(options.size_limit->count)};
    const AppearanceSpec appearance = appearance_spec(options);
    switch (options.size_of) {
        case SizeOf::kWeb: {
            const PackedScene sample = packed_sample(options, scene);
            plan.fixed = ngsplat_bytes(sample, 0, kTrailerBytes);
            plan.unit = ngsplat_unit();
            plan.per_gaussian = sample.bytes_per_gaussian(false);
            plan.per_residual = sample.bytes_per_gaussian() - plan.per_gaussian;
            plan.share = wanted_residual_share(options, appearance).value_or(kMostAutoShare);
            break;
        }
        case SizeOf::kPly:
            plan.fixed = kPlyHeaderBytes + std::int64_t(sizeof(float)) * appearance_model(appearance.model).num_shared;
            plan.per_gaussian = ply_bytes_per_gaussian(appearance);
            break;
        case SizeOf::kSplat:
            plan.per_gaussian = kSplatBytes;
    }
    if (plan.limit < plan.bytes(1))
        throw UsageError(
            fmt::format("option size-limit: {} is too small: the smallest {} file of {} takes {} bytes here",
                        options.size_limit->text(), word(options.size_of), options.appearance, plan.bytes(1)));
    const double most = double(plan.limit - plan.fixed) / plan.mean_bytes();
    plan.most_gaussians = (std::int64_t(most) / plan.unit + 1) * plan.unit;
    while (plan.most_gaussians > plan.unit && plan.bytes(plan.most_gaussians) > plan.limit)
        plan.most_gaussians -= plan.unit;
    return plan;
}

TrainingPlan make_plan(const TrainOptions& options, const Scene& scene, std::size_t held_out) {
    TrainingPlan plan;
    if (!options.time_limit && !options.size_limit && !options.frame_limit && !options.target_psnr &&
        options.preset == Preset::kNone)
        return plan;
    plan.json = nlohmann::ordered_json::object();
    plan.num_views = scene.train.size();
    note_full_count(plan, options, scene);
    plan_the_time(plan, options);
    if (options.size_limit) plan_the_size(plan, options, scene);
    if (options.frame_limit) {
        const double seconds = options.frame_limit->seconds;
        plan.lines.push_back(fmt::format("frames: at most {:g} ms at 1280x720 on this device", 1e3 * seconds));
        plan.json["frame"] = {{"limit_seconds", seconds}};
    }
    if (options.target_psnr) {
        plan.lines.push_back(fmt::format(
            "quality: {:g} dB on {} held-out training views; longer trainings until that is reached, then fewer "
            "Gaussians until it would be lost",
            *options.target_psnr, held_out));
        plan.json["target"] = {{"psnr", *options.target_psnr}, {"held_out_views", held_out}};
    }
    const std::vector<std::string> kept = kept_from_recipe(options);
    plan.lines.push_back(fmt::format("recipe: {}{}", word(options.recipe),
                                     kept.empty() ? "" : fmt::format(", but {} as named", fmt::join(kept, ", "))));
    plan.json["recipe"] = word(options.recipe);
    if (options.preset != Preset::kNone) plan.json["preset"] = word(options.preset);
    return plan;
}

std::string training_words(const TrainingPlan& plan, const TrainOptions& options) {
    std::vector<std::string> words;
    if (options.strategy != Strategy::kNone) {
        const bool by_size = plan.size && plan.size->most_gaussians < options.cap_max;
        words.push_back(fmt::format("at most {} Gaussians ({})", by_size ? plan.size->most_gaussians : options.cap_max,
                                    by_size ? "--size-limit" : "--cap-max"));
    }
    if (options.frame_limit) words.push_back(fmt::format("frames of at most {}", options.frame_limit->text()));
    if (options.target_psnr) words.push_back(fmt::format("until {:g} dB are reached", *options.target_psnr));
    if (options.time_limit)
        words.push_back(duration_text(options.time_limit->seconds));
    else
        words.push_back(fmt::format("{}{} iterations", options.target_psnr ? "at most " : "", options.iterations));
    if (!plan.estimate.empty()) words.push_back(plan.estimate);
    return fmt::format("{}", fmt::join(words, ", "));
}

void note_outcome(TrainingPlan& plan, const TrainOptions& options, const TrainSummary& summary) {
    if (plan.json.is_null()) return;
    if (summary.limited_seconds > 0) {
        log_debug("time limit {}: {:.2f} s were used, of which {:.2f} s for pruning and saving",
                  options.time_limit->text(), summary.limited_seconds, summary.saving_seconds);
        plan.json["time"]["seconds"] = summary.limited_seconds;
        plan.json["time"]["saving_seconds"] = summary.saving_seconds;
    }
    if (plan.size) {
        SizePlan size = *plan.size;
        size.share = std::min(size.share, summary.residual_share);
        const std::int64_t bytes = size.bytes(summary.num_gaussians);
        const double use = double(bytes) / double(plan.size->limit);
        log_info("size limit {}: {} Gaussians make a file of {} ({:.0f} %)", options.size_limit->text(),
                 summary.num_gaussians, megabytes(bytes), 100 * use);
        const bool small_enough = summary.target && summary.target->reached;  // the target allows a smaller model
        if (!small_enough && summary.num_gaussians < std::min(plan.size->most_gaussians, options.cap_max) &&
            use < kLeastUse)
            log_warning("size limit {}: only {:.0f} % of it is used{}", options.size_limit->text(), 100 * use,
                        !options.time_limit ? ": in these --iterations the model did not grow further"
                                            : ": the time limit does not afford more Gaussians");
        plan.json["size"]["bytes"] = bytes;
    }
    if (summary.target) {
        nlohmann::ordered_json& json = plan.json["target"];
        json["reached"] = summary.target->reached;
        json["held_out_psnr"] = summary.target->psnr;
        json["standard_error"] = summary.target->standard_error;
        json["measurements"] = summary.target->measurements;
        if (summary.target->estimate > 0) json["estimate"] = summary.target->estimate;
        json["verdict"] = summary.target->verdict;
        // The standard error: uncertainty of a mean over few views as an estimate for other views.
        log_info("target {:g} dB: another choice of views may have a mean that differs by {:.2f} dB (standard error)",
                 *options.target_psnr, summary.target->standard_error);
    }
    if (summary.frame_seconds > 0) {
        log_info("frame limit {}: frames take {:.3g} ms", options.frame_limit->text(), 1e3 * summary.frame_seconds);
        plan.json["frame"]["seconds"] = summary.frame_seconds;
    }
    plan.json["num_gaussians"] = summary.num_gaussians;
    note_loss(plan, options, summary);
}

}  // namespace gs
