// SPDX-License-Identifier: Apache-2.0
// `gsapp bench`: what an iteration and a frame cost on this machine. Its subcommands have files of their own.
#include "apps/gsapp/bench.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>

#include "apps/gsapp/printing.h"
#include "apps/gsapp/ranks.h"
#include "eval/bench/bench_cases.h"
#include "eval/bench/ranked_bench.h"
#include "eval/runs/bench_subject.h"
#include "eval/runs/saved_run.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/options_cli.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/model_file.h"
#include "lib/train/choose_backend.h"
#include "lib/train/sharded_backend.h"

namespace gs {
namespace {

struct BenchArguments {
    BenchRepeats repeats;
    std::string file;  ///< a point cloud without a run; empty: none
    std::int64_t iteration = -1;
    std::vector<std::int64_t> generate;
    bool compare_deterministic = false, json = false;
};

/// Prints tables as soon as they are there, and JSON as one object at the end.
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
    const auto backend = choose_backend(options.device, appearance_spec(options), backend_options(options));
    Results results(arguments.json);
    for (const std::int64_t count : arguments.generate)
        results.add(bench_generated(*backend, options, count, bench, arguments.compare_deterministic));
    results.end();
}

/// Measures generated sets that several ranks hold. In the processes of the other ranks it does their part.
void bench_generated_sets_on_ranks(const TrainArguments& train, const BenchArguments& arguments) {
    if (arguments.generate.empty())
        throw UsageError("bench --ranks measures generated sets; name their sizes with --generate");
    if (arguments.compare_deterministic)
        throw UsageError("bench --ranks does not measure --compare-deterministic; name one of them");
    if (arguments.repeats.frame_repeat > 0)
        throw UsageError("bench --ranks times steps and no frames; leave out --frame-repeat");
    TrainOptions options = train.resolve({.stored_run = false, .default_source = "generated"});
    const auto team = join_ranks(num_local_ranks(options), "bench", "", options.threads);
    setup_log(shown_messages(options));
    if (!team) set_num_threads(options.threads);
    if (team && team->rank() > 0) return follow_sharding(*team, started_as("bench"));
    const BenchOptions bench = bench_options(options.device, arguments.repeats.repeat, 0);
    std::vector<RankedBenchResult> results;
    for (const std::int64_t count : arguments.generate)
        results.push_back(bench_ranks(team.get(), options, count, bench));
    const std::string text = arguments.json ? ranked_bench_json(results) : format_ranked_bench(results, stdout_style());
    std::fputs(text.c_str(), stdout);
}

void bench_scene(const TrainArguments& train, const BenchArguments& arguments) {
    TrainOptions options = measured_options(train, arguments.file);
    prepare_bench(options);
    const BenchOptions bench = bench_options(options.device, arguments.repeats.repeat, arguments.repeats.frame_repeat);
    const BenchSubject subject = bench_subject(options, saved_iteration(arguments.iteration));
    set_appearance(options, subject.model.appearance);
    const auto backend = choose_backend(options.device, subject.model.appearance, backend_options(options));
    BenchResult result =
        bench_model(*backend, options, subject.scene, subject.model, bench, arguments.compare_deterministic);
    result.subject = subject.name;
    Results results(arguments.json);
    results.add(result);
    results.end();
}

}  // namespace

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

CLI::Option* add_generate_option(CLI::App& command, std::vector<std::int64_t>& sizes) {
    // Checks run after transforms in the order they were added, so the range is that of the whole number.
    return command
        .add_option("--generate", sizes, "Measure generated sets of these sizes, such as 1M,3M,6M; needs no scene")
        ->delimiter(',')
        ->transform(CLI::AsNumberWithUnit(std::map<std::string, std::int64_t>{{"k", 1000}, {"m", 1000000}},
                                          CLI::AsNumberWithUnit::CASE_INSENSITIVE))
        ->check(CLI::Range(std::int64_t(0), std::int64_t(1000000000)));
}

CLI::Option* add_iteration_option(CLI::App& command, std::int64_t& iteration) {
    return command.add_option("--iteration", iteration, "Saved iteration of a run to measure (default: the last)")
        ->check(CLI::NonNegativeNumber);
}

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

TrainOptions measured_options(const TrainArguments& train, const std::string& file) {
    TrainOptions options = train.combine({.stored_run = true, .default_source = ""});
    if (!file.empty()) options.model = file;
    if (!options.model.empty()) require_model_file(options.model);
    if (options.source.empty() && !options.model.empty() && is_point_cloud(options.model))
        throw UsageError("'" + options.model +
                         "' is a point cloud without a run, which has no views: name their scene with --source SCENE");
    validate(options);
    return options;
}

void prepare_bench(const TrainOptions& options) {
    setup_log(shown_messages(options));
    set_num_threads(options.threads);
}

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
            !subcommands.empty()) {  // whose callback has set `selected` already
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
