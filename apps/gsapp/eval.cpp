// SPDX-License-Identifier: Apache-2.0
// `gsapp eval`: scores finished runs and prints a table of them; `gsapp metrics`: compares two images, or scores runs
// (3DGS's name for `gsapp eval`).
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/gsapp/arguments.h"
#include "apps/gsapp/command.h"
#include "apps/gsapp/printing.h"
#include "eval/metrics/metrics.h"
#include "eval/report/comparison.h"
#include "eval/report/report.h"
#include "eval/runs/evaluate_run.h"
#include "eval/runs/protocol.h"
#include "eval/runs/results.h"
#include "kernels/base/error.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/io/temporary.h"

namespace gs {
namespace {

struct MetricArguments {
    std::string names;    ///< list for parse_metric_names
    std::string weights;  ///< folder for metric_weights_folder
    std::optional<Device> device = {};
};

struct EvalArguments {
    std::vector<std::string> runs;
    std::int64_t iteration = -1;  ///< -1 = the last saved iteration
    std::string format;           ///< empty = Markdown, plain text on a terminal
    std::string protocol = protocols().front().name;
    std::string ssim_border, ppisp_eval, align_test, html, output;
    /// Scene to score on instead of a run's own, and the scene of point clouds without a run; null: each run's own
    /// scene.
    std::shared_ptr<SceneArguments> scene;
    int frame_rounds = 0;
    std::optional<int> marks;
    MetricArguments metrics{"psnr,ssim", ""};
    bool skip_render = false, decompose = false;
    bool json = false;
    int ranks = 1;
};

/// Adds the run folders, which may also be given with -m as in 3DGS's scripts. Returns the option.
CLI::Option* add_runs_option(CLI::App& command, std::vector<std::string>& runs, const std::string& positional,
                             const std::string& help = "Run folders", const std::string& type_name = "RUN") {
    const std::string names = "-m,--model,--model_path";
    return command.add_option(positional.empty() ? names : positional + "," + names, runs, help)->type_name(type_name);
}

/// Adds --metrics, --metric-weights and --device. Their values are stored in `arguments`, which must outlive `command`.
void add_metric_options(CLI::App& command, MetricArguments& arguments) {
    command
        .add_option("--metrics", arguments.names,
                    "Any of psnr, ssim, lpips-vgg, lpips-alex, flip, dists, milo, with commas between; or all")
        ->capture_default_str()
        ->type_name("LIST");
    command
        .add_option("--metric-weights", arguments.weights,
                    "Folder of weights for lpips, dists and milo, from scripts/export_metric_weights.py (default: "
                    "$GSAPP_METRIC_WEIGHTS)")
        ->type_name("DIR");
    command
        .add_option_function<std::string>(
            "--device", [&arguments](const std::string& text) { arguments.device = choice_of<Device>(text); },
            "Where learned metrics are computed (default: auto), and runs rendered (default: as they were trained): "
            "auto, "
            "cpu or cuda")
        ->check(CLI::IsMember(words<Device>()));
}

/// Returns the options of the metrics. Throws UsageError.
MetricOptions metric_options(const MetricArguments& arguments, LpipsRange lpips_range) {
    MetricOptions options;
    options.lpips_range = lpips_range;
    options.weights = metric_weights_folder(arguments.weights);
    if (arguments.device) options.device = *arguments.device;
    return options;
}

TableFormat format_of(const EvalArguments& arguments) {
    if (arguments.json) return TableFormat::kJson;
    if (!arguments.format.empty()) return parse_table_format(arguments.format);
    return ::isatty(STDOUT_FILENO) != 0 ? TableFormat::kTerminal : TableFormat::kMarkdown;
}

/// A model to score, and the folder of its results.
struct Subject {
    std::string run;  ///< as typed by the user: a run folder, or a point cloud without a run
    std::filesystem::path results;
    bool keep_pictures = true;
};

/// Returns the models with their results folders. Results of a point cloud without a given folder go to `temporary`.
std::vector<Subject> subjects(const EvalArguments& arguments, const RunChanges& changes,
                              std::optional<WorkFolder>& temporary) {
    if (!arguments.output.empty() && arguments.runs.size() > 1)
        throw UsageError("--output is the folder of one model's results; name one model");
    std::vector<Subject> all;
    for (const std::string& run : arguments.runs) {
        Subject subject{run, results_folder(run, changes)};
        if (!arguments.output.empty()) {
            subject.results = arguments.output;
        } else if (is_point_cloud(run)) {
            if (arguments.skip_render)
                throw UsageError(fmt::format(
                    "--skip-render: '{}' stores no results; name the folder that eval --output wrote", run));
            if (!temporary) temporary.emplace(own_temporary_folder() / "eval");
            subject.results = temporary->path() / std::to_string(all.size());
            subject.keep_pictures = !arguments.html.empty();  // source of the page's images
        }
        all.push_back(subject);
    }
    return all;
}

/// Scores a subject. Results of a run on another scene are stored in a separate folder.
void evaluate(Subject& subject, std::optional<std::int64_t> iteration, const RunChanges& changes,
              const Protocol& protocol, const std::vector<Metric>& metrics, const EvalArguments& arguments) {
    SavedRun run = open_saved_run(subject.run, iteration, changes);
    if (!run.is_other_scene && arguments.output.empty() && !is_point_cloud(subject.run)) subject.results = subject.run;
    EvalOptions options;
    options.protocol = protocol;
    options.metrics = metrics;
    if (subject.keep_pictures) options.run_folder = subject.results;
    options.iteration = run.iteration;
    options.correction = run.correction;
    options.correction.mode = choose_correction(arguments.ppisp_eval, run.correction.mode);
    options.align_cameras = arguments.align_test == "cameras";
    options.decompose = arguments.decompose || !arguments.html.empty();  // the page's slider shows the parts
    evaluate_run(run, options, arguments.frame_rounds, subject.results);
}

/// Renders and scores the runs, and prints one table over all of them.
void run_eval(const EvalArguments& arguments) {
    // Invalid arguments are detected before any run is rendered.
    const TableFormat format = format_of(arguments);
    Protocol protocol = find_protocol(arguments.protocol);
    if (!arguments.ssim_border.empty()) protocol.ssim_border = parse_ssim_border(arguments.ssim_border);
    std::vector<std::string> further = parse_metric_names(arguments.metrics.names);
    std::erase_if(further,
                  [](const std::string& name) { return name == "psnr" || name == "ssim"; });  // always computed
    const std::vector<Metric> metrics = make_metrics(further, metric_options(arguments.metrics, protocol.lpips_range));
    const auto iteration = arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration);
    RunChanges changes = arguments.scene ? arguments.scene->changes(arguments.runs) : RunChanges{};
    changes.device = arguments.metrics.device;
    changes.scores = true;
    changes.other_scene = true;
    const auto group = join_ranks(arguments.ranks, "eval", fmt::format("{}", fmt::join(arguments.runs, " ")));
    if (group && group->rank() > 0) return follow_command(*group, started_as("eval"));
    changes.group = group.get();
    std::vector<RunResult> runs;
    std::optional<WorkFolder> temporary;
    for (Subject& subject : subjects(arguments, changes, temporary)) {
        if (!arguments.skip_render) evaluate(subject, iteration, changes, protocol, metrics, arguments);
        runs.push_back(read_results(subject.results, iteration));
        const bool bare = is_point_cloud(subject.run);
        if (!bare) read_training(runs.back(), subject.run);
        if (bare || subject.results != subject.run || !arguments.output.empty()) runs.back().run = subject.run;
    }
    const auto corrected = std::find_if(runs.begin(), runs.end(),
                                        [&](const RunResult& run) { return run.correction() != runs[0].correction(); });
    if (corrected != runs.end())
        log_warning("views of {} and {} were corrected differently (column ppisp; protocol in results.json)",
                    runs[0].run, corrected->run);
    const Comparison comparison = compare_runs(runs);
    std::fputs(format_comparison(comparison, format, arguments.marks).c_str(), stdout);
    if (arguments.html.empty()) return;
    write_report(arguments.html, comparison, {});
    log_info("the same with plots and pictures: {}", arguments.html);
}

struct CompareArguments {
    std::string render, truth;
    std::string ssim_border, lpips_range = "symmetric";
    MetricArguments metrics{"all", ""};
    std::vector<std::string> runs;
    bool json = false;
};

void compare(const CompareArguments& arguments) {
    MetricOptions options = metric_options(arguments.metrics, parse_lpips_range(arguments.lpips_range));
    options.ssim_border = parse_ssim_border(arguments.ssim_border.empty() ? "valid" : arguments.ssim_border);
    const auto names = parse_metric_names(arguments.metrics.names);
    const std::vector<ImageScore> scores = compare_images(arguments.render, arguments.truth, names, options);
    std::fputs(arguments.json ? (json_text(scores_json(scores), 1) + "\n").c_str() : format_scores(scores).c_str(),
               stdout);
}

void run_metrics(const CompareArguments& arguments) {
    if (arguments.runs.empty()) {
        if (arguments.truth.empty()) throw UsageError("metrics: name two images, RENDER and TRUTH, or runs, -m RUN");
        return compare(arguments);
    }
    EvalArguments eval;
    eval.runs = arguments.runs;
    eval.ssim_border = arguments.ssim_border;
    eval.metrics = arguments.metrics;
    eval.json = arguments.json;
    run_eval(eval);
}

}  // namespace

void add_eval_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<EvalArguments>();
    CLI::App* command = app.add_subcommand(
        "eval", "Render and score the test views of finished runs or of .ply files; print one table over all of them");
    add_runs_option(*command, arguments->runs, "runs", "Run folders, or .ply files with the scene that --source names",
                    "RUN|FILE.ply")
        ->required();
    command
        ->add_option("-o,--output", arguments->output,
                     "Folder for results.json, per_view.json and pictures (default: the run's; of a .ply file nothing "
                     "is kept)")
        ->type_name("DIR");
    command->add_option("--iteration", arguments->iteration, "Saved iteration to evaluate (default: the last)")
        ->check(CLI::NonNegativeNumber);
    CLI::Option* format =
        command->add_option("--format", arguments->format, "Tables as markdown (default), csv, latex or json");
    command->add_flag("--json", arguments->json, "Short for --format json")->excludes(format);
    command
        ->add_option("--mark", arguments->marks,
                     "Places that tables mark in each column, 0 to 3: bold, underlined, italic (default: 3 if more "
                     "than three lines compare, otherwise 1)")
        ->check(CLI::Range(0, 3));
    add_quiet_flag(*command);
    CLI::Option* skip = command->add_flag("--skip-render", arguments->skip_render,
                                          "Only print the table of results that are already stored");
    add_metric_options(*command, arguments->metrics);
    for (const char* option : {"--metrics", "--metric-weights", "--device"})
        command->get_option(option)->excludes(skip);
    command
        ->add_option("--protocol", arguments->protocol,
                     "How scores are made: paper, inria (3DGS) or gsplat; printed under every table")
        ->capture_default_str()
        ->excludes(skip);
    command
        ->add_option("--ssim-border", arguments->ssim_border,
                     "SSIM at the image border: valid, reflect or zero, instead of the protocol's")
        ->excludes(skip);
    command
        ->add_option("--time-frames", arguments->frame_rounds,
                     "Rounds through the test views in which frames are timed, for the column FPS")
        ->check(CLI::Range(0, 100000))
        ->excludes(skip);
    command
        ->add_flag("--decompose", arguments->decompose,
                   "Also write base and residual of each test view, and the residual's mean")
        ->excludes(skip);
    command
        ->add_option("--align-test", arguments->align_test,
                     "cameras: score the test views also with poses that are fitted to the model; results.json and the "
                     "log have both, tables the given poses")
        ->check(CLI::IsMember({"cameras"}))
        ->excludes(skip);
    command
        ->add_option("--html", arguments->html,
                     "Also write the tables with plots and a comparison of pictures as one HTML page")
        ->type_name("FILE");
    command
        ->add_option(
            "--ppisp-eval", arguments->ppisp_eval,
            "How views are corrected photometrically: controller (default if the model has one), none, "
            "colour-aligned (fits each view to its "
            "photograph), scene-aligned (no vignetting, and fits the scene's colours to all photographs at once)")
        ->excludes(skip);
    add_ranks_option(*command, arguments->ranks)->excludes(skip);
    arguments->scene = std::make_shared<SceneArguments>(
        *command,
        "Score on the test views of this scene: needed for a .ply file. A run is scored on it instead of its own, with "
        "its other options, and results go to RUN/on-SCENE; if its own is gone, and this is the same at another place, "
        "to RUN",
        DeviceOption::kOfCommand);
    command->callback([arguments, &selected] { selected = [arguments] { run_eval(*arguments); }; });
}

void add_metrics_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<CompareArguments>();
    CLI::App* command = app.add_subcommand(
        "metrics",
        "Compare two images, as 8 bits and with alpha on black, by the metrics of eval; with -m RUN the same as eval");
    CLI::Option* runs = add_runs_option(*command, arguments->runs, "");
    command->add_option("render", arguments->render, "The image to judge")->type_name("RENDER")->excludes(runs);
    command->add_option("truth", arguments->truth, "The image it should equal")->type_name("TRUTH")->excludes(runs);
    add_metric_options(*command, arguments->metrics);
    command->add_option(
        "--ssim-border", arguments->ssim_border,
        "SSIM at the image border: valid, reflect or zero (3DGS) (default: valid; of runs as protocol paper has it)");
    command
        ->add_option("--lpips-range", arguments->lpips_range,
                     "What LPIPS is given: symmetric (mapped to [-1,1], torchmetrics with normalize=True) or unit "
                     "(left in [0,1], 3DGS)")
        ->capture_default_str()
        ->excludes(runs);
    command->add_flag("--json", arguments->json,
                      "Full numbers as JSON: scores (null = infinite), not_measured, protocol");
    add_quiet_flag(*command);
    command->callback([arguments, &selected] { selected = [arguments] { run_metrics(*arguments); }; });
}

}  // namespace gs
