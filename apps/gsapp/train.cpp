// SPDX-License-Identifier: Apache-2.0
// `gsapp train`: loads the scene, runs the trainer, measures the held-out views.
#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "apps/gsapp/command.h"
#include "eval/auto/find_appearance.h"
#include "eval/bench/bench.h"
#include "eval/experiments/cell.h"
#include "eval/report/comparison_format.h"
#include "eval/runs/results.h"
#include "eval/runs/saved_run.h"
#include "kernels/core/error.h"
#include "kernels/cuda/cuda_device.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/options_cli.h"
#include "lib/core/progress.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"
#include "lib/train/scene_options.h"
#include "lib/train/trainer.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr int kComparisonViews = 4;  // enough to judge a scene, small enough for one screen

/// output/<scene>-<appearance>-<n>: the first n that is free, with `suffix` behind it.
std::string default_run_folder(const TrainOptions& options, const std::string& suffix = "") {
    for (int n = 1;; ++n) {
        const fs::path folder = fs::path("output") / (scene_name(options.source) + "-" + options.appearance + "-" + std::to_string(n));
        if (!fs::exists(folder.string() + suffix)) return folder.string();
    }
}

void describe_scene(const Scene& scene) {
    log_info("{}: {} training views, {} test views ({}), {} points", scene.source, scene.train.size(), scene.test.size(),
                 scene.split_rule, scene.points.positions.size());
    for (const std::string& note : scene.notes) log_warning("{}", note);
}

/// Measures the held-out views during and after training, and keeps the latest scores.
class Evaluation {
  public:
    /// `frame_rounds`: how often frames of the trained model are timed; 0 = not at all.
    Evaluation(const TrainOptions& options, const Scene& scene, Progress& progress, int frame_rounds)
        : options_(options), scene_(scene), progress_(progress), frame_rounds_(frame_rounds) {}

    void operator()(std::int64_t iteration, Backend& backend) {
        // Pictures of intermediate iterations would fill disks; their scores are kept.
        const bool last = iteration == options_.iterations;
        const Vec3<float>& background = options_.background.color;
        eval_ = {.run_folder = last ? fs::path(options_.model) : fs::path(), .iteration = iteration, .correction = saved_correction(options_.model)};
        result_ = evaluate_views(backend, scene_.test, background, eval_);
        facts_ = run_facts(options_, scene_, background, backend.count());
        if (last && frame_rounds_ > 0) facts_.frame_seconds = frame_seconds(backend, scene_.test, background, frame_rounds_);
        write_results(RunFolder{options_.model}, eval_, result_, facts_);
        if (last) write_comparison(comparison(), backend, scene_.test, background, kComparisonViews, eval_.correction);
        const bool corrected = eval_.correction.mode != CorrectionMode::kOff;
        log_info("iteration {}: PSNR {:.2f}, SSIM {:.4f} on {} test views{}", iteration, result_.psnr, result_.ssim, result_.views.size(),
                     corrected ? fmt::format(", photometric correction: {}", correction_name(eval_.correction.mode)) : "");
        progress_.event({{"event", "evaluation"},
                         {"iteration", iteration},
                         {"views", result_.views.size()},
                         {"psnr", result_.psnr},
                         {"ssim", result_.ssim},
                         {"ppisp_eval", correction_name(eval_.correction.mode)}});
    }

    /// Adds time and memory of the training, which are known only now, and returns the row for tables.
    TableRow finish(const TrainSummary& summary) {
        facts_.train_seconds = summary.train_seconds;
        if (summary.controller_seconds > 0) facts_.controller_seconds = summary.controller_seconds;
        facts_.photometric = summary.photometric;
        facts_.appearance_choice = read_appearance_choice(options_.model);
        if (summary.memory.peak > 0) facts_.peak_device_bytes = summary.memory.peak;
        write_results(RunFolder{options_.model}, eval_, result_, facts_);
        log_info("photographs and renders side by side: {}", comparison().string());
        TableRow row = read_table_row(options_.model, eval_.iteration);
        read_training(row, options_.model);
        return row;
    }

  private:
    fs::path comparison() const { return fs::path(options_.model) / "comparison.png"; }

    const TrainOptions& options_;
    const Scene& scene_;
    Progress& progress_;
    const int frame_rounds_;
    EvalOptions eval_;
    EvalResult result_;
    RunFacts facts_;
};

void write_choice(const fs::path& run_folder, const nlohmann::ordered_json& choice) {
    write_text_atomic(RunFolder{run_folder}.appearance_choice(), choice.dump(1) + "\n");
}

/// Trains one run. Returns its row where views were held out.
std::optional<TableRow> run_training(TrainOptions options, int frame_rounds) {
    setup_log(shown_messages(options));
    if (options.device == Device::kCuda && !cuda_available()) throw DeviceError("option device: " + cuda_unavailable_reason() + "; use --device cpu");
    if (options.model.empty()) options.model = default_run_folder(options);
    // The scene comes first: with a mistake in it, an earlier run that --overwrite would remove stays as it is.
    const Scene scene = load_scene(scene_options(options));
    if (options.appearance == kAutoAppearance && !options.resume.empty()) options.appearance = checkpoint_appearance(options);
    RunStart start = open_run(options);
    add_log_file(fs::path(options.model) / "gsapp.log");
    log_info("{}, output folder {}", version_text(), options.model);
    describe_scene(scene);

    catch_interrupts();
    if (options.appearance == kAutoAppearance) {
        const AppearanceReport report = find_appearance(options, scene);
        for (const std::string& line : report.lines) log_info("--appearance auto: {}", line);
        write_choice(options.model, report.json);
        start.first_event = report.json;
        start.first_event["event"] = "appearance_choice";
        options.appearance = report.model;
    }
    Progress progress(options.quiet ? ProgressStyle::kSilent : default_progress_style());
    Evaluation evaluation(options, scene, progress, frame_rounds);
    TrainHooks hooks;
    const bool measure = options.eval && !scene.test.empty();
    if (measure)
        hooks.evaluate = std::ref(evaluation);
    else if (options.eval)
        log_warning("--eval: there are no test views ({})", scene.split_rule);
    const TrainSummary summary = train(options, scene, std::move(start), progress, hooks);
    progress.finish();
    log_info("{} iterations in {:.1f} s ({:.1f} s waiting for images), {} Gaussians", summary.iterations, summary.train_seconds,
                 summary.data_wait_seconds, summary.num_gaussians);
    if (summary.controller_seconds > 0) log_info("{} iterations of the controllers in {:.1f} s, besides", options.controller_iterations, summary.controller_seconds);
    if (nlohmann::ordered_json choice = read_appearance_choice(options.model); !choice.is_null() && options.resume.empty()) {
        choice["share_of_training"] = choice.value("seconds", 0.0) / summary.train_seconds;
        write_choice(options.model, choice);
        log_info("--appearance auto took {:.1f} s, {:.2f} of the training", choice.value("seconds", 0.0), choice.value("share_of_training", 0.0));
    }
    std::optional<TableRow> row;
    if (measure) row = evaluation.finish(summary);
    nlohmann::ordered_json finished = {{"event", "finished"},
                                       {"iteration", options.iterations},
                                       {"num_gaussians", summary.num_gaussians},
                                       {"train_seconds", summary.train_seconds}};
    if (summary.controller_seconds > 0) finished["controller_seconds"] = summary.controller_seconds;
    if (summary.memory.peak > 0) finished["peak_device_bytes"] = summary.memory.peak;
    finished["model"] = options.model;
    progress.event(finished);
    return row;
}

/// Where a program reads JSON lines on stdout, the table is for the people who read the messages.
void print_table(const std::vector<TableRow>& rows, bool quiet) {
    if (rows.empty()) return;
    const std::string table = format_comparison(compare_runs(rows), TableFormat::kMarkdown);
    std::fputs(table.c_str(), !quiet && default_progress_style() == ProgressStyle::kJsonLines ? stderr : stdout);
}

/// Trains the same with `num_runs` seeds in a row, into <model>-0, <model>-1, ..., and prints their mean and deviation.
void run_seeds(TrainOptions base, int frame_rounds, int num_runs) {
    if (!base.resume.empty()) throw UsageError("--runs: runs are not resumed; the same command again trains those that are missing");
    require_named_appearance(base);
    if (!base.eval) throw UsageError("--runs: there is nothing to average without --eval");
    if (base.model.empty()) base.model = default_run_folder(base, "-0");
    std::vector<TableRow> rows;
    for (int k = 0; k < num_runs; ++k) {
        TrainOptions options = base;
        options.seed = base.seed + std::uint64_t(k);
        options.model = fmt::format("{}-{}", base.model, k);
        std::optional<TableRow> row;
        if (!options.overwrite) row = finished_run(options);
        if (row)
            log_info("run {} of {}: finished before in {}", k + 1, num_runs, options.model);
        else
            row = run_training(options, frame_rounds);
        if (row) rows.push_back(*row);
    }
    print_table(rows, base.quiet);
}

}  // namespace

void add_train_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand("train", "Train a scene");
    const auto arguments = std::make_shared<TrainArguments>(*command);
    const auto frame_rounds = std::make_shared<int>(0);
    command->add_option("--time-frames", *frame_rounds, "With --eval: rounds through the test views in which frames of the trained model are timed, for results.json")
        ->check(CLI::Range(0, 100000));
    const auto num_runs = std::make_shared<int>(0);
    command->add_option("--runs", *num_runs, "With --eval: train that many times, with seeds SEED, SEED+1, ..., into MODEL-0, MODEL-1, ..., and print mean "
                                             "and deviation. Called again, trains only what is missing")
        ->check(CLI::Range(1, 1000));
    command->callback([=, &selected] {
        selected = [=] {
            const TrainOptions options = arguments->resolve();
            if (*num_runs > 0)
                run_seeds(options, *frame_rounds, *num_runs);
            else if (const auto row = run_training(options, *frame_rounds))
                print_table({*row}, options.quiet);
        };
    });
}

}  // namespace gs
