// SPDX-License-Identifier: Apache-2.0
// `gsapp bench`: what an iteration and a frame cost on this machine; frame times of several runs; how stable the appearance models
// compute; and suites of training runs.
#include <fmt/format.h>

#include <cstdio>
#include <map>
#include <memory>

#include "appearance/model_info.h"
#include "apps/gsapp/command.h"
#include "apps/gsapp/frames.h"
#include "apps/gsapp/suite.h"
#include "eval/bench/bench.h"
#include "eval/bench/generated_set.h"
#include "eval/bench/precision.h"
#include "eval/bench/stability.h"
#include "eval/experiments/suite.h"
#include "eval/runs/saved_run.h"
#include "kernels/core/error.h"
#include "kernels/core/parallel.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/options_cli.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/choose_backend.h"
#include "lib/train/scene_options.h"

namespace gs {
namespace {

struct BenchArguments {
    int repeat = 0, frame_repeat = 0;  ///< 0 = by device
    std::int64_t iteration = -1;       ///< -1 = the last saved one
    std::vector<std::int64_t> generate;
    bool compare_deterministic = false, stability = false, frames = false, precision = false;
    std::vector<std::string> runs;         ///< of --frames
    std::string suite;                     ///< empty = none
    std::vector<std::string> appearances;  ///< empty = by command
};

/// A GPU needs many short steps for one good number; on the CPU the same number of them would take minutes.
BenchOptions repeats(const BenchArguments& arguments, const TrainOptions& options) {
    const bool cuda = uses_cuda(options.device);
    return {.repeat = arguments.repeat > 0 ? arguments.repeat : cuda ? 100 : 20,
            .frame_repeat = arguments.frame_repeat > 0 ? arguments.frame_repeat : cuda ? 100 : 3};
}

void measure(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model, const std::string& subject,
             const BenchArguments& arguments) {
    const BenchOptions bench = repeats(arguments, options);
    BenchResult result = run_bench(backend, options, scene, model, bench);
    result.subject = subject;
    if (arguments.compare_deterministic) {
        BackendOptions other = backend_options(options);
        other.deterministic = !other.deterministic;
        const auto changed = choose_backend(options.device, model.appearance, other);
        const double seconds = iteration_seconds(*changed, options, scene, model, bench);
        result.deterministic_seconds = options.deterministic ? result.iteration_seconds : seconds;
        result.default_seconds = options.deterministic ? seconds : result.iteration_seconds;
    }
    std::fputs((format_bench(result) + "\n").c_str(), stdout);
}

void measure_generated(const TrainOptions& options, const BenchArguments& arguments) {
    const auto backend = choose_backend(options.device, appearance_spec(options), backend_options(options));
    for (const std::int64_t count : arguments.generate) {
        const Gaussians model = generated_gaussians(count, options.seed, appearance_spec(options));
        backend->upload(model);
        const Scene scene = generated_scene(*backend, options.background.color);
        measure(*backend, options, scene, model, fmt::format("generated set of {:.3g} M Gaussians, seed {}", double(count) / 1e6, options.seed), arguments);
    }
}

void measure_scene(const TrainOptions& options, const BenchArguments& arguments) {
    const bool trained = holds_model(options.model);
    if (arguments.iteration >= 0 && !trained) throw UsageError("--iteration: there is no trained model in '" + options.model + "'; name its folder with -m");
    std::string subject = options.source + ", initial points";
    Gaussians model;
    if (trained) {  // read first: a mistake here should not wait for the scene
        SavedModel saved = read_saved_model(options.model, arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration));
        model = std::move(saved.state);
        model.active_degree = model.appearance.max_degree;
        subject = fmt::format("{}, {} at iteration {}", options.source, options.model, saved.iteration);
    }
    const Scene scene = load_scene(scene_options(options));
    if (scene.train.empty()) throw DataError(scene.source + ": no training views (all were held out or skipped)");
    if (!trained) model = initial_model(options, scene);
    if (arguments.precision) {
        std::fputs((subject + "\n\n" + markdown_table(precision_table(measure_precision(options, scene, model, repeats(arguments, options))))).c_str(), stdout);
        return;
    }
    const auto backend = choose_backend(options.device, model.appearance, backend_options(options));
    measure(*backend, options, scene, model, subject, arguments);
}

void measure_frames(const TrainOptions& options, const BenchArguments& arguments) {
    if (arguments.runs.empty() && arguments.generate.empty()) throw UsageError("--frames: name folders of runs, or sets with --generate");
    run_frames({.runs = arguments.runs,
                .iteration = arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration),
                .generate = arguments.generate,
                .appearances = arguments.appearances.empty() ? appearance_names() : arguments.appearances,
                .frames_per_view = repeats(arguments, options).frame_repeat},
               options);
}

void run_bench_command(const TrainArguments& train, const BenchArguments& arguments) {
    if (!arguments.appearances.empty() && arguments.suite.empty() && !arguments.frames)
        throw UsageError("--appearances: only --suite and --frames compare models; --appearance names one");
    if (arguments.stability) {
        std::fputs(markdown_table(stability_table(measure_stability())).c_str(), stdout);
        return;
    }
    if (!arguments.suite.empty()) {
        const TrainOptions base = train.combine();
        setup_log(shown_messages(base));
        run_suite(arguments.suite, arguments.appearances.empty() ? std::vector<std::string>{"sh", "nasgabor", "neural"} : arguments.appearances, base);
        return;
    }
    const bool no_scene = !arguments.generate.empty() || arguments.frames;
    const TrainOptions options = train.resolve({.stored_run = !no_scene, .default_source = no_scene ? "generated" : ""});
    setup_log(options.quiet ? LogLevel::kWarn : options.log_level);
    set_num_threads(options.threads);
    if (arguments.frames)
        measure_frames(options, arguments);
    else if (no_scene)
        measure_generated(options, arguments);
    else
        measure_scene(options, arguments);
}

}  // namespace

void add_bench_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand("bench",
                                           "Measure frames and iterations, stage by stage: of the trained model in -m RUN, of a scene's initial points, or of "
                                           "generated sets");
    const auto train = std::make_shared<TrainArguments>(*command);
    const auto arguments = std::make_shared<BenchArguments>();
    command->add_option("--repeat", arguments->repeat, "Iterations in one measurement (default: 100 on a GPU, 20 on the CPU)")->check(CLI::Range(1, 100000));
    command->add_option("--frame-repeat", arguments->frame_repeat, "Times that each view is rendered (default: 100 on a GPU, 3 on the CPU)")
        ->check(CLI::Range(1, 100000));
    CLI::Option* iteration = command->add_option("--iteration", arguments->iteration, "With -m RUN or --frames RUN: saved iteration to measure (default: the last)")
                                 ->check(CLI::NonNegativeNumber);
    // Checks run after transforms in the order they were added, so the range is that of the whole number.
    CLI::Option* generate = command->add_option("--generate", arguments->generate, "Sizes of generated sets, e.g. 1M,3M,6M; needs no scene")
        ->delimiter(',')
        ->transform(CLI::AsNumberWithUnit(std::map<std::string, std::int64_t>{{"k", 1000}, {"m", 1000000}}, CLI::AsNumberWithUnit::CASE_INSENSITIVE))
        ->check(CLI::Range(std::int64_t(1), std::int64_t(1000000000)))
        ->excludes(iteration);
    command->add_flag("--compare-deterministic", arguments->compare_deterministic, "Also measure iterations with --deterministic, and print the ratio");
    CLI::Option* stability =
        command->add_flag("--stability", arguments->stability, "Instead: numerical errors of every appearance model at the extremes; needs no scene and no GPU")
            ->excludes(iteration)
            ->excludes(generate);
    CLI::Option* suite = command->add_option("--suite", arguments->suite,
                                             "Instead: train the runs of an experiment, one at a time or one on each GPU, and tabulate them; "
                                             "finished ones in -m FOLDER are kept")
                             ->check(CLI::IsMember(suite_names()))
                             ->excludes(iteration)
                             ->excludes(generate)
                             ->excludes(stability);
    command->add_flag("--precision", arguments->precision,
                      "Instead, of the model in -m RUN or the initial points: time and error of frames, against double precision, at every precision that options choose")
        ->excludes(stability)
        ->excludes(suite)
        ->excludes(generate);
    CLI::Option* frames = command->add_option("--frames", arguments->runs,
                                              "Instead: frame times of the runs in these folders at 1280x720 pixels, by view, in one table and in their results.json; "
                                              "with --generate also of generated sets, the same Gaussians for every model")
                              ->expected(0, CLI::detail::expected_max_vector_size)
                              ->type_name("[RUN ...]")
                              ->excludes(stability)
                              ->excludes(suite);
    command->add_option("--appearances", arguments->appearances,
                        "Appearance models of --suite (default: sh, nasgabor, neural) and of the generated sets of --frames (default: all)")
        ->delimiter(',');
    command->callback([train, arguments, frames, &selected] {
        arguments->frames = frames->count() > 0;
        std::erase(arguments->runs, "");  // what CLI11 makes of the option without a value
        selected = [train, arguments] { run_bench_command(*train, *arguments); };
    });
}

}  // namespace gs
