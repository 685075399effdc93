// SPDX-License-Identifier: Apache-2.0
// Loads the scene, chooses an appearance if requested, holds out views for a target, trains, and scores.
#include "apps/gsapp/train/train_run.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "appearance/model_info.h"
#include "apps/gsapp/live/live_training.h"
#include "apps/gsapp/train/plan.h"
#include "eval/auto/find_appearance.h"
#include "eval/auto/rehearsal.h"
#include "eval/report/comparison.h"
#include "eval/runs/run_scene.h"
#include "eval/runs/saved_run.h"
#include "eval/runs/training_evaluation.h"
#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/input_file.h"
#include "lib/core/interrupt.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/progress.h"
#include "lib/core/quantities.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/cameras_json.h"
#include "lib/scene/scene.h"
#include "lib/scene/verify_images.h"
#include "lib/train/choose_backend.h"
#include "lib/train/follow_training.h"
#include "lib/train/group_backend.h"
#include "lib/train/residual_share.h"

namespace gs {
namespace {

std::vector<Photograph> take_views(Scene& scene, const Vec3<float>& background) {
    if (scene.train.size() < kFewestViews)
        throw UsageError(fmt::format("option target-psnr: {} training views are too few to hold one out; {} are needed",
                                     scene.train.size(), kFewestViews));
    std::vector<View> held_out, rest;
    for (std::size_t k = 0; k < scene.train.size(); ++k)
        (is_held_out(k) ? held_out : rest).push_back(std::move(scene.train[k]));
    scene.train = std::move(rest);
    return load_photographs(held_out, background);
}

namespace fs = std::filesystem;

/// Decodes all images as --verify-images requires. Views of a built-in scene are computed and cannot be damaged.
void verify(const TrainOptions& options, Scene& scene, Progress& progress) {
    constexpr std::size_t kMany = 4000;  // decoding more images takes minutes
    const std::size_t images = scene.train.size() + scene.test.size();
    if (scene.kind == "builtin" || options.verify_images == VerifyImages::kOff ||
        (options.verify_images == VerifyImages::kAuto && images > kMany))
        return;
    set_num_threads(options.threads);
    const double start = seconds_now();
    verify_images(scene, options.image_cache.count,
                  [&](std::int64_t done, std::int64_t total) { progress.count("images decoded", done, total); });
    progress.finish();
    log_debug("{} images decoded in {:.1f} s", images, seconds_now() - start);
}

void describe_scene(const Scene& scene) {
    log_info("{}: {} training views, {} test views ({}), {} points", scene.source, scene.train.size(),
             scene.test.size(), scene.split_rule, scene.points.positions.size());
    if (!scene.frame.is_identity())
        log_debug(
            "trained in a frame of the usual size: centre ({:.9g}, {:.9g}, {:.9g}), scale {:.6g}; what is written is "
            "in the scene's own coordinates",
            scene.frame.center.x(), scene.frame.center.y(), scene.frame.center.z(), scene.frame.scale);
    // Present in few scenes: masks, an unusual folder or file. They change the model without a user's request.
    for (const std::string& fact : scene.facts) log_info("{}", fact);
    for (const std::string& note : scene.notes) log_warning("{}", note);
}

void write_choice(const fs::path& run_folder, const nlohmann::ordered_json& choice) {
    write_text_atomic(RunFolder{run_folder}.appearance_choice(), json_text(choice, 1) + "\n");
}

/// Sets the model chosen by `--appearance auto`, and writes the reasons to auto.json and as an event of the log.
void resolve_auto_appearance(TrainOptions& options, const Scene& scene, RunStart& start) {
    const AppearanceReport report = find_appearance(options, scene);
    for (const std::string& line : report.lines)
        log_message(&line == &report.lines.back() ? LogLevel::kInfo : LogLevel::kDebug, "--appearance auto: {}",
                    fmt::make_format_args(line));
    write_choice(options.model, report.json);
    start.first_events.emplace_back(report.json)["event"] = "appearance_choice";
    options.appearance = report.model;
    start.used_seconds += report.json.value("seconds", 0.0);
}

/// Decides the parts whose options are `auto`, and writes the reasons as events of the log. A resumed run goes on as it
/// began.
void resolve_auto_parts(TrainOptions& options, const Scene& scene, RunStart& start) {
    if (start.checkpoint) {
        if (options.ppisp == PpispMode::kAuto) set_part(options, Part::kPpisp, start.checkpoint->state.ppisp.active());
        if (options.refine_cameras == RefineCameras::kAuto)
            set_part(options, Part::kCameras, !start.checkpoint->cameras.views.empty());
        return;
    }
    for (const PartTrial& trial : rehearse(options, scene)) {
        const PartDecision decision = decide(trial);
        log_message(trial.obstacle.empty() ? LogLevel::kInfo : LogLevel::kWarn, "--{} auto: {}",
                    fmt::make_format_args(option_of(trial.part), decision.reason));
        start.first_events.push_back(event_of(trial, decision));
        start.used_seconds += trial.seconds;
    }
}

/// Replaces the selected model by the model without residuals if no Gaussian is to have a residual: for a share of 0,
/// and for auto if direction explains nothing. Returns whether it did.
bool resolve_no_residuals(TrainOptions& options, const Scene& scene) {
    const AppearanceSpec appearance = appearance_spec(options);
    const std::optional<double> share = wanted_residual_share(options, appearance);
    const std::string plain = plain_sh_appearance(0).model;
    std::string reason;
    if (share == 0) {
        reason = "no Gaussian is to have a residual";
    } else if (!share && !options.resume.empty()) {
        if (checkpoint_appearance(options) == plain) reason = "so the checkpoint has it";
    } else if (!share) {
        const DirectionTest test = test_direction(options, scene);
        if (test.explains_nothing)
            reason = fmt::format("held-out training views show less than {:g} dB in what depends on the direction",
                                 options.auto_tolerance);
        else if (!test.obstacle.empty())
            log_info("--appearance-share auto: whether the scene needs residuals at all was not looked at: {}",
                     test.obstacle);
    }
    if (reason.empty()) return false;
    log_info("--appearance-share: {} instead of {}: {}", plain, options.appearance, reason);
    options.appearance = plain;
    return true;
}

/// Adds to auto.json the duration of the choice relative to the training that followed.
void add_share_of_training(const TrainOptions& options, const TrainSummary& summary) {
    nlohmann::ordered_json choice = read_appearance_choice(options.model);
    if (choice.is_null() || !summary.whole_time) return;
    choice["share_of_training"] = choice.value("seconds", 0.0) / summary.train_seconds;
    write_choice(options.model, choice);
    log_debug("--appearance auto took {:.1f} s, {:.2f} of the training", choice.value("seconds", 0.0),
              choice.value("share_of_training", 0.0));
}

void describe_training(const TrainSummary& summary) {
    constexpr double kMuch = 0.05;  // share of the time; a smaller wait is no reason for faster storage
    const bool waited = summary.data_wait_seconds > kMuch * summary.train_seconds;
    log_info("{} iterations in {:.1f} s{}{}, {} Gaussians", summary.iterations, summary.train_seconds,
             summary.whole_time ? "" : " since the checkpoint",
             waited ? fmt::format(" ({:.1f} s waiting for images)", summary.data_wait_seconds) : "",
             summary.num_gaussians);
    if (summary.controller_seconds > 0)
        log_debug("{} iterations of the controllers in {:.1f} s, besides", summary.controller_iterations,
                  summary.controller_seconds);
}

/// Logs the files that were written, and the next commands.
void describe_outcome(const TrainOptions& options, const TrainSummary& summary) {
    const RunFolder folder{options.model};
    log_info("point cloud: {}", folder.point_cloud(summary.iterations).string());
    log_info("look at it with: gsapp view {0}; make a web page of it with: gsapp export {0} -o DIR", options.model);
}

nlohmann::ordered_json finished_event(const TrainOptions& options, const TrainSummary& summary) {
    nlohmann::ordered_json event = {
        {"event", "finished"}, {"iteration", summary.iterations}, {"num_gaussians", summary.num_gaussians}};
    RunResult trained;
    add_training(trained, summary);
    event.update(result_json(trained, {"train_seconds", "controller_seconds", "peak_device_bytes"}));
    event["model"] = options.model;
    return event;
}

/// Returns the options in effect that differ from their defaults, as "key value, ...".
std::string changed_options(const TrainOptions& options) {
    std::string list;
    for (const Option& option : train_option_table())
        if (const std::string text = option_text(option, options); text != option_text(option, TrainOptions{}))
            list += fmt::format("{}{} {}", list.empty() ? "" : ", ", option.key, text);
    return list;
}

/// Adds the live page to the hooks of a training.
TrainHooks watched(TrainHooks hooks, LiveTraining& live) {
    hooks.between = [&live](const TrainProgress& now, Backend& backend) { return live.between(now, backend); };
    hooks.saved = [&live](std::int64_t iteration, const std::string& error) { live.saved(iteration, error); };
    hooks.evaluate = [&live, evaluate = std::move(hooks.evaluate)](std::int64_t iteration, Backend& backend,
                                                                   bool last) {
        const auto scores = evaluate ? evaluate(iteration, backend, last) : std::nullopt;
        if (last) live.finish(iteration, backend);
        return scores;
    };
    return hooks;
}

}  // namespace

TargetViews::TargetViews(const TrainOptions& options, Scene& scene)
    : background_(options.background.color), photographs_(take_views(scene, background_)) {
    if (photographs_.empty())
        throw UsageError("option target-psnr: masks leave no pixel of the views that were held out");
}

HeldOutPsnr TargetViews::psnr(Backend& backend) const {
    const std::vector<double> all = psnrs(backend, photographs_, background_, backend.download_ppisp().active());
    const ColumnStats stats = column_stats(all, Better::kHigher);
    return {stats.mean, stats.deviation.value_or(0) / std::sqrt(double(all.size()))};
}

std::string free_run_folder(const fs::path& parent, const TrainOptions& options, const std::string& suffix) {
    for (int n = 1;; ++n) {
        const fs::path folder =
            parent / (scene_name(options.source) + "-" + options.appearance + "-" + std::to_string(n));
        if (!path_exists(folder.string() + suffix)) return folder.string();
    }
}

std::optional<RunResult> train_run(TrainOptions options, int frame_rounds, const std::optional<LiveView>& view,
                                   RankGroup* group) {
    setup_log(shown_messages(options));
    try_device(options.device);
    if (!options.model.empty()) require_free_folder(options);
    // Nothing is written before the scene is loaded: if the scene is invalid, an earlier run that --overwrite would
    // remove stays intact.
    LoadRules rules{.scores = options.eval};
    if (!options.resume.empty()) rules.frame = checkpoint_frame(options);
    Scene scene =
        options.resume.empty() ? load_scene(options, rules) : load_run_scene(resumed_run(options), options, rules);
    std::string cameras = cameras_json(scene);
    Progress progress(progress_style(options.quiet, options.json));
    verify(options, scene, progress);
    std::optional<TargetViews> target;
    if (options.target_psnr) target.emplace(options, scene);
    if (options.model.empty()) options.model = free_run_folder("output", options);
    if (options.appearance == kAutoAppearance && !options.resume.empty())
        options.appearance = checkpoint_appearance(options);
    // Limits that cannot be met are refused before an earlier run in the folder is changed.
    TrainingPlan plan;
    const std::size_t held_out = target ? target->count() : 0;
    if (options.appearance != kAutoAppearance) plan = make_plan(options, scene, held_out);
    std::optional<LiveTraining> live;  // may also be refused, so before an earlier run is changed
    if (view) {
        set_num_threads(options.threads);  // not while the page's threads use them
        live.emplace(options, scene, view->port);
        log_info("watch it at {}", live->address());
        progress.event({{"event", "view"}, {"address", live->address()}});
    }
    std::optional<TensorBoard> tensorboard;  // may also be refused, so before an earlier run is changed
    if (!options.tensorboard.empty()) tensorboard.emplace(options.tensorboard);
    RunStart start = open_run(options, view_digest(scene.test));
    start.cameras = std::move(cameras);
    add_log_file(fs::path(options.model) / "gsapp.log");
    log_debug("{}, output folder {}", version_text(), options.model);
    describe_scene(scene);
    if (has_builtin_cap(options))
        log_debug("at most {} Gaussians, as for every built-in scene; --cap-max names another number", options.cap_max);

    catch_interrupts();
    resolve_auto_parts(options, scene, start);
    if (options.appearance == kAutoAppearance) resolve_auto_appearance(options, scene, start);
    if (resolve_no_residuals(options, scene)) plan = {};
    if (plan.json.is_null()) plan = make_plan(options, scene, held_out);
    log_debug("options that are not at their defaults: {}", changed_options(options));
    for (const std::string& line : plan.lines) log_debug("plan: {}", line);
    log_info("training {}, {}, into {}", options.appearance, training_words(plan, options), options.model);
    TrainingEvaluation evaluation(options, scene, progress, frame_rounds);
    TrainHooks hooks;
    if (plan.size) hooks.most_gaussians = std::min(plan.size->most_gaussians, options.cap_max);
    if (tensorboard) hooks.tensorboard = &*tensorboard;
    if (target) hooks.held_out_psnr = [&](Backend& backend) { return target->psnr(backend); };
    const bool measure = options.eval && !scene.test.empty();
    if (measure)
        hooks.evaluate = std::ref(evaluation);
    else if (options.eval)
        log_warning("--eval: there are no test views ({})", scene.split_rule);
    if (live) hooks = watched(std::move(hooks), *live);
    if (group || options.batch.value_or(1) > 1)
        hooks.make_backend = [&](const AppearanceSpec& appearance, const EngineOptions& engine) {
            return make_backend(options.device, appearance, engine, group, step_views(options, scene, group));
        };
    const auto lock = start.lock;
    TrainSummary summary;
    try {
        summary = train(options, scene, std::move(start), progress, hooks);
    } catch (const std::exception& e) {
        if (live) live->end(dynamic_cast<const Interrupted*>(&e) ? "stopped" : "failed", e.what());
        throw;
    }
    progress.finish();
    lock->check_folder();
    describe_training(summary);
    note_outcome(plan, options, summary);
    add_share_of_training(options, summary);
    std::optional<RunResult> result;
    if (measure) {
        evaluation.finish(summary, plan.json);
        result = read_results(options.model, evaluation.iteration());
        read_training(*result, options.model);
    }
    describe_outcome(options, summary);
    progress.event(finished_event(options, summary));
    return result;
}

}  // namespace gs
