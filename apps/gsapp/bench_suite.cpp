// SPDX-License-Identifier: Apache-2.0
// `gsapp bench suite`: trains the runs of an experiment and tabulates them.
#include <fmt/ranges.h>

#include <cstdio>
#include <memory>

#include "apps/gsapp/bench.h"
#include "apps/gsapp/printing.h"
#include "eval/experiments/suite_run.h"
#include "eval/experiments/train_run.h"
#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/options_cli.h"

namespace gs {
namespace {

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

}  // namespace

void add_bench_suite_command(CLI::App& bench, Command& selected) {
    CLI::App* command = bench.add_subcommand(
        "suite",
        "Train the runs of an experiment, one at a time or one on each GPU, and print a table of them; "
        "finished ones in -m FOLDER are kept");
    const auto arguments = std::make_shared<SuiteArguments>();
    // Declared before the scene, which may stand without a flag, too.
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

}  // namespace gs
