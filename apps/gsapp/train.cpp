// SPDX-License-Identifier: Apache-2.0
// `gsapp train`: trains a run, or the same with several seeds, and prints the table of scores.
#include <cstdio>
#include <memory>

#include "apps/gsapp/command.h"
#include "eval/experiments/seeds.h"
#include "eval/experiments/train_run.h"
#include "eval/report/comparison_format.h"
#include "lib/core/options_cli.h"
#include "lib/core/progress.h"

namespace gs {
namespace {

/// Prints to stdout, or to stderr where a program reads JSON lines on stdout: there the table is for the people who
/// read the messages.
void print_table(const std::vector<TableRow>& rows, bool quiet) {
    if (rows.empty()) return;
    const std::string table = format_comparison(compare_runs(rows), TableFormat::kMarkdown);
    std::fputs(table.c_str(), !quiet && default_progress_style() == ProgressStyle::kJsonLines ? stderr : stdout);
}

}  // namespace

void add_train_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand("train", "Train a scene");
    const auto arguments = std::make_shared<TrainArguments>(*command);
    const auto frame_rounds = std::make_shared<int>(0);
    command
        ->add_option("--time-frames", *frame_rounds,
                     "With --eval: time frames of the trained model in that many rounds through the test views, for "
                     "results.json")
        ->check(CLI::Range(0, 100000));
    const auto num_runs = std::make_shared<int>(0);
    command
        ->add_option("--runs", *num_runs,
                     "With --eval: train that many times, with seeds SEED, SEED+1, ..., into MODEL-0, MODEL-1, ..., "
                     "and print mean "
                     "and deviation. Called again, trains only what is missing")
        ->check(CLI::Range(1, 1000));
    command->callback([=, &selected] {
        selected = [=] {
            const TrainOptions options = arguments->resolve();
            if (*num_runs > 0)
                print_table(train_seeds(options, *num_runs,
                                        [&](const TrainOptions& one) { return train_run(one, *frame_rounds); }),
                            options.quiet);
            else if (const auto row = train_run(options, *frame_rounds))
                print_table({*row}, options.quiet);
        };
    });
}

}  // namespace gs
