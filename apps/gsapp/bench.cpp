// SPDX-License-Identifier: Apache-2.0
// `gsapp bench`: the cost of an iteration and a frame on this machine; and its subcommands for frame times, precision,
// stability and experiment suites.
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "appearance/model_info.h"
#include "apps/gsapp/arguments.h"
#include "apps/gsapp/command.h"
#include "apps/gsapp/printing.h"
#include "apps/gsapp/train/train_run.h"
#include "eval/bench/bench.h"
#include "eval/bench/bench_cases.h"
#include "eval/bench/precision.h"
#include "eval/bench/ranked_bench.h"
#include "eval/bench/stability.h"
#include "eval/experiments/suite.h"
#include "eval/runs/bench_subject.h"
#include "eval/runs/saved_run.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/options_cli.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/model_file.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"

namespace gs {
namespace {

/// The values of --repeat and --frame-repeat.
struct BenchRepeats {
    int repeat = 0, frame_repeat = 0;  ///< 0 = default of the device
};

inline std::optional<std::int64_t> saved_iteration(std::int64_t iteration) {
    return iteration < 0 ? std::nullopt : std::optional(iteration);
}

void add_repeat_option(CLI::App& command, BenchRepeats& repeats) {
    command
        .add_option("--repeat", repeats.repeat, "Iterations in one measurement (default: 100 on a GPU, 20 on the CPU)")
        ->check(CLI::Range(1, 100000));
}

void add_frame_repeat_option(CLI::App& command, BenchRepeats& repeats) {
    command
        .add_option("--frame-repeat", repeats.frame_repeat,
                    "Times that each view is rendered (default: 100 on a GPU, 3 on the CPU)")
        ->check(CLI::Range(1, 100000));
}

/// Adds --generate. Returns the option.
CLI::Option* add_generate_option(CLI::App& command, std::vector<std::int64_t>& sizes) {
    // Checks run after transforms in the order they were added, so the range applies to the whole number.
    return command
        .add_option("--generate", sizes, "Measure generated sets of these sizes, such as 1M,3M,6M; needs no scene")
        ->delimiter(',')
        ->transform(CLI::AsNumberWithUnit(std::map<std::string, std::int64_t>{{"k", 1000}, {"m", 1000000}},
                                          CLI::AsNumberWithUnit::CASE_INSENSITIVE))
        ->check(CLI::Range(std::int64_t(0), std::int64_t(1000000000)));
}

/// Adds --iteration; -1 = the last saved iteration. Returns the option.
CLI::Option* add_iteration_option(CLI::App& command, std::int64_t& iteration) {
    return command.add_option("--iteration", iteration, "Saved iteration of a run to measure (default: the last)")
        ->check(CLI::NonNegativeNumber);
}

/// Adds the .ply file that may be given without a flag, like -m FILE.ply. Must be called before the scene, which may
/// also be given without a flag, is declared.
void add_point_cloud_option(CLI::App& command, std::string& file) {
    command.validate_positionals();  // folders, builtin:NAME and transforms.json are left to the scene
    command.add_option("file", file, "Point cloud to measure, with the scene of its views in -s")
        ->type_name("FILE.ply")
        ->check(CLI::Validator(
            [](const std::string& word) {
                const bool is_scene = word.ends_with(".json") && !word.ends_with("meta.json");
                return is_point_cloud(word) && !is_scene ? "" : "not a .ply file";
            },
            ""));
}

/// Returns the options for measuring a trained model: those of the run in -m, or for a point cloud (`file`, or -m
/// FILE.ply) those of the flags. Throws UsageError, also for a point cloud without a scene.
TrainOptions measured_options(const TrainArguments& train, const std::string& file) {
    TrainOptions options = train.combine({.stored_run = true, .default_source = ""});
    if (!file.empty()) options.model = file;
    if (!options.model.empty()) require_model_file(options.model);
    if (options.source.empty() && !options.model.empty() && is_point_cloud(options.model))
        throw UsageError("'" + options.model +
                         "' is a point cloud without a run, which has no views: name their scene with --source SCENE");
    options = resolve(options);
    return options;
}

/// Sets up messages and threads according to the options.
void prepare_bench(const TrainOptions& options) {
    setup_log(shown_messages(options));
    set_num_threads(options.threads);
}

struct BenchArguments {
    BenchRepeats repeats;
    std::string file;  ///< a point cloud without a run; empty: none
    std::int64_t iteration = -1;
    std::vector<std::int64_t> generate;
    bool compare_deterministic = false, json = false;
};

/// Prints tables immediately, and JSON as one object at the end.
class Results {
  public:
    explicit Results(bool json) : json_(json) {}
    void add(const BenchResult& result) {
        results_.push_back(result);
        if (!json_) std::fputs((format_bench(result, stdout_style()) + "\n").c_str(), stdout);
    }
    void end() const {
        if (json_) std::fputs(bench_json(results_).c_str(), stdout);
    }

  private:
    bool json_;
    std::vector<BenchResult> results_;
};

void bench_generated_sets(const TrainArguments& train, const BenchArguments& arguments) {
    const TrainOptions options = train.resolve({.stored_run = false, .default_source = "generated"});
    prepare_bench(options);
    const BenchOptions bench = bench_options(options.device, arguments.repeats.repeat, arguments.repeats.frame_repeat);
    const auto backend = make_backend(options.device, appearance_spec(options), engine_options(options));
    log_device(options.device, *backend);
    Results results(arguments.json);
    for (const std::int64_t count : arguments.generate)
        results.add(bench_generated(*backend, options, count, bench, arguments.compare_deterministic));
    results.end();
}

/// Measures generated sets that are distributed over several ranks. In the processes of other ranks it does their part.
void bench_generated_sets_on_ranks(const TrainArguments& train, const BenchArguments& arguments) {
    if (arguments.generate.empty())
        throw UsageError("bench --ranks measures generated sets; name their sizes with --generate");
    if (arguments.compare_deterministic)
        throw UsageError("bench --ranks does not measure --compare-deterministic; name one of them");
    if (arguments.repeats.frame_repeat > 0)
        throw UsageError("bench --ranks times steps and no frames; leave out --frame-repeat");
    TrainOptions options = train.resolve({.stored_run = false, .default_source = "generated"});
    const auto group = join_ranks(num_local_ranks(options), "bench", "", options.threads);
    setup_log(shown_messages(options));
    if (!group) set_num_threads(options.threads);
    if (group && group->rank() > 0) return follow_command(*group, started_as("bench"));
    const BenchOptions bench = bench_options(options.device, arguments.repeats.repeat, 0);
    std::vector<RankedBenchResult> results;
    for (const std::int64_t count : arguments.generate)
        results.push_back(bench_ranks(group.get(), options, count, bench));
    const std::string text = arguments.json ? ranked_bench_json(results) : format_ranked_bench(results, stdout_style());
    std::fputs(text.c_str(), stdout);
}

void bench_scene(const TrainArguments& train, const BenchArguments& arguments) {
    TrainOptions options = measured_options(train, arguments.file);
    prepare_bench(options);
    const BenchOptions bench = bench_options(options.device, arguments.repeats.repeat, arguments.repeats.frame_repeat);
    const BenchSubject subject = bench_subject(options, saved_iteration(arguments.iteration));
    set_appearance(options, subject.model.appearance);
    const auto backend = make_backend(options.device, subject.model.appearance, engine_options(options));
    log_device(options.device, *backend);
    BenchResult result =
        bench_model(*backend, options, subject.scene, subject.model, bench, arguments.compare_deterministic);
    result.subject = subject.name;
    Results results(arguments.json);
    results.add(result);
    results.end();
}

struct FramesArguments {
    std::vector<std::string> runs;
    std::int64_t iteration = -1;
    std::vector<std::int64_t> generate;
    std::vector<std::string> appearances;  ///< empty = all
    BenchRepeats repeats;
    bool json = false;
};

void bench_frames(const TrainArguments& train, const FramesArguments& arguments) {
    const std::vector<std::string>& runs = arguments.runs;
    const TrainOptions options = train.resolve({.stored_run = false, .default_source = "generated"});
    prepare_bench(options);
    if (runs.empty() && arguments.generate.empty())
        throw UsageError("bench frames: name folders of runs, or sizes of generated sets with --generate");
    const int frames_per_view = bench_options(options.device, 0, arguments.repeats.frame_repeat).frame_repeat;
    std::vector<FrameTimesLine> lines;
    RunChanges of_files{.device = options.device, .point_cloud = options};
    of_files.point_cloud->source = train.combine().source;
    // With point clouds, --source is their scene; otherwise it is the new path of the runs' scene.
    if (std::none_of(runs.begin(), runs.end(), is_point_cloud)) of_files.source = of_files.point_cloud->source;
    for (const std::string& run : runs)
        lines.push_back(time_run_frames(run, saved_iteration(arguments.iteration), of_files, frames_per_view));
    for (const std::int64_t count : arguments.generate)
        for (const std::string& appearance :
             arguments.appearances.empty() ? appearance_names() : arguments.appearances) {
            TrainOptions with = options;
            with.appearance = appearance;
            lines.push_back(time_generated_frames(count, with, frames_per_view));
        }
    const std::string text = arguments.json
                                 ? frame_times_json(lines)
                                 : table_text(frame_times_table(lines), stdout_style()) + "\n" + kFrameProtocol + "\n";
    std::fputs(text.c_str(), stdout);
}

struct PrecisionArguments {
    BenchRepeats repeats;
    std::string file;  ///< a point cloud without a run; empty: none
    std::int64_t iteration = -1;
    bool json = false;
};

void bench_precision(const TrainArguments& train, const PrecisionArguments& arguments) {
    const TrainOptions options = measured_options(train, arguments.file);
    prepare_bench(options);
    const BenchOptions bench = bench_options(options.device, arguments.repeats.repeat, arguments.repeats.frame_repeat);
    const BenchSubject subject = bench_subject(options, saved_iteration(arguments.iteration));
    const std::vector<PrecisionRow> rows = measure_precision(options, subject.scene, subject.model, bench);
    const std::string text = arguments.json ? precision_json(subject.name, rows)
                                            : subject.name + "\n\n" + table_text(precision_table(rows), stdout_style());
    std::fputs(text.c_str(), stdout);
}

struct SuiteArguments {
    std::string suite;
    std::vector<std::string> appearances = {"sh", "nasgabor", "neural"};
    bool json = false;
};

void bench_suite(const TrainOptions& base, const SuiteArguments& arguments) {
    if (arguments.suite.empty())
        throw UsageError(fmt::format("bench suite: name one of {}", fmt::join(suite_names(), ", ")));
    setup_log(shown_messages(base));
    catch_interrupts();
    const SuiteRun done = run_suite(arguments.suite, arguments.appearances, base);
    std::fputs(
        (arguments.json ? suite_json(arguments.suite, done.lines) : format_suite(done.lines, stdout_style())).c_str(),
        stdout);
    throw_unless_complete(done.summary, done.lines.size(), done.folder / "suite.md");
}

// Each function adds one subcommand to `bench`, whose callback sets `selected`.
void add_bench_frames_command(CLI::App& bench, Command& selected) {
    CLI::App* command = bench.add_subcommand(
        "frames",
        "Time frames of runs at 1280x720 pixels, view by view; print one table and add the times to the "
        "runs' results.json");
    const auto arguments = std::make_shared<FramesArguments>();
    // Declared before the scene, which may also be given without a flag.
    command->add_option("runs", arguments->runs, "Run folders, or .ply files with the scene of their views in -s")
        ->type_name("RUN|FILE.ply");
    const auto train = std::make_shared<TrainArguments>(*command);
    add_iteration_option(*command, arguments->iteration);
    add_generate_option(*command, arguments->generate);
    command
        ->add_option("--appearances", arguments->appearances,
                     "Appearance models of the generated sets, each with the same Gaussians (default: all)")
        ->delimiter(',');
    add_frame_repeat_option(*command, arguments->repeats);
    add_json_flag(*command, arguments->json);
    command->callback(
        [train, arguments, &selected] { selected = [train, arguments] { bench_frames(*train, *arguments); }; });
}

void add_bench_precision_command(CLI::App& bench, Command& selected) {
    CLI::App* command = bench.add_subcommand(
        "precision",
        "Measure time, memory and error against double precision at every precision that options choose, "
        "of the trained model in -m RUN or in a .ply file, or of a scene's initial points");
    const auto arguments = std::make_shared<PrecisionArguments>();
    add_point_cloud_option(*command, arguments->file);
    const auto train = std::make_shared<TrainArguments>(*command);
    add_repeat_option(*command, arguments->repeats);
    add_frame_repeat_option(*command, arguments->repeats);
    add_iteration_option(*command, arguments->iteration);
    add_json_flag(*command, arguments->json);
    command->callback(
        [train, arguments, &selected] { selected = [train, arguments] { bench_precision(*train, *arguments); }; });
}

void add_bench_stability_command(CLI::App& bench, Command& selected) {
    CLI::App* command = bench.add_subcommand(
        "stability",
        "Measure the numerical errors of every appearance model at extreme inputs; needs no scene and no GPU");
    const auto json = std::make_shared<bool>(false);
    add_json_flag(*command, *json);
    command->add_flag("-q,--quiet")->description("Taken as by the other commands; there are no messages here");
    command->callback([json, &selected] {
        selected = [json] {
            const std::vector<StabilityRow> rows = measure_stability();
            std::fputs((*json ? stability_json(rows) : table_text(stability_table(rows), stdout_style())).c_str(),
                       stdout);
        };
    });
}

void add_bench_suite_command(CLI::App& bench, Command& selected) {
    CLI::App* command = bench.add_subcommand(
        "suite",
        "Train the runs of an experiment, one at a time or one on each GPU, and print a table of them; "
        "finished ones in -m FOLDER are kept");
    const auto arguments = std::make_shared<SuiteArguments>();
    // Declared before the scene, which may also be given without a flag.
    command->add_option("name", arguments->suite, "The experiment")->check(CLI::IsMember(suite_names()));
    const auto train = std::make_shared<TrainArguments>(*command);
    command
        ->add_option("--appearances", arguments->appearances,
                     "Appearance models, with commas between (default: sh,nasgabor,neural)")
        ->delimiter(',');
    add_json_flag(*command, arguments->json);
    command->callback([train, arguments, &selected] {
        selected = [train, arguments] { bench_suite(train->combine(), *arguments); };
    });
}

}  // namespace

void add_bench_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand(
        "bench",
        "Measure frames and iterations, stage by stage, of the trained model in -m RUN or in a .ply file, of a "
        "scene's initial points, or of generated sets");
    command->require_subcommand(0, 1);
    const auto arguments = std::make_shared<BenchArguments>();
    add_point_cloud_option(*command, arguments->file);
    const auto train = std::make_shared<TrainArguments>(*command);
    add_repeat_option(*command, arguments->repeats);
    add_frame_repeat_option(*command, arguments->repeats);
    CLI::Option* iteration = add_iteration_option(*command, arguments->iteration);
    add_generate_option(*command, arguments->generate)->excludes(iteration);
    command->add_flag("--compare-deterministic", arguments->compare_deterministic,
                      "Also measure iterations with --deterministic, and print the ratio");
    add_json_flag(*command, arguments->json);
    add_bench_frames_command(*command, selected);
    add_bench_suite_command(*command, selected);
    add_bench_precision_command(*command, selected);
    add_bench_stability_command(*command, selected);
    command->callback([train, arguments, command, &selected] {
        if (const auto subcommands = command->get_subcommands();
            !subcommands.empty()) {  // its callback has set `selected` already
            for (const CLI::Option* option : command->get_options())
                if (option->count() > 0)
                    throw UsageError(option->get_name() + " stands before '" + subcommands.front()->get_name() +
                                     "'; write the options after it");
            return;
        }
        const bool on_ranks = command->get_option("--ranks")->count() > 0;
        selected = [train, arguments, on_ranks] {
            if (on_ranks) return bench_generated_sets_on_ranks(*train, *arguments);
            arguments->generate.empty() ? bench_scene(*train, *arguments) : bench_generated_sets(*train, *arguments);
        };
    });
}

}  // namespace gs
