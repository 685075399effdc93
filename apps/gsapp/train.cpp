// SPDX-License-Identifier: Apache-2.0
// `gsapp train`: trains a run, or one run per seed for several seeds, and prints the table of scores.
#include <unistd.h>

#include <charconv>
#include <cstdio>
#include <memory>
#include <optional>

#include "apps/gsapp/command.h"
#include "apps/gsapp/train/seeds.h"
#include "apps/gsapp/train/train_run.h"
#include "eval/report/comparison.h"
#include "kernels/base/error.h"
#include "lib/core/options_cli.h"
#include "lib/train/follow_training.h"
#include "lib/train/group_backend.h"

namespace gs {
namespace {

/// Prints the table to stdout, or to stderr if stdout carries JSON lines for a program: the table belongs with the
/// messages for readers.
void print_table(const std::vector<RunResult>& runs, const TrainOptions& options) {
    if (runs.empty()) return;
    const bool terminal = ::isatty(options.json ? STDERR_FILENO : STDOUT_FILENO) != 0;
    const std::string table =
        format_comparison(compare_runs(runs), terminal ? TableFormat::kTerminal : TableFormat::kMarkdown);
    std::fputs(table.c_str(), options.json ? stderr : stdout);
}

/// Returns the port of --view, which may be omitted. Throws UsageError for an invalid port.
std::optional<int> port_of(const std::string& text) {
    if (text.empty()) return std::nullopt;
    int port = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), port);
    if (error != std::errc() || end != text.data() + text.size() || port < 0 || port > 65535)
        throw UsageError("option view: '" + text + "' is no port, which is a number from 0 to 65535" +
                         " (a scene is named before --view, or with -s)");
    return port;
}

}  // namespace

void add_train_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand("train", "Train a scene");
    const auto arguments = std::make_shared<TrainArguments>(*command);
    const auto frame_rounds = std::make_shared<int>(0);
    command
        ->add_option("--time-frames", *frame_rounds,
                     "With --eval: time frames of the trained model; in that many rounds through the test views, for "
                     "results.json")
        ->check(CLI::Range(0, 100000));
    const auto num_runs = std::make_shared<int>(0);
    command
        ->add_option(
            "--runs", *num_runs,
            "With --eval: train that many times and print mean and deviation; with seeds SEED, SEED+1, ..., into "
            "MODEL-0, MODEL-1, ... Called again, trains only what is missing")
        ->check(CLI::Range(1, 1000));
    const auto view = std::make_shared<std::string>();
    CLI::Option* view_option =
        command
            ->add_option("--view", *view,
                         "Show the training in a browser while it goes on; on this machine, at this port of 127.0.0.1 "
                         "(without a number 8000, or any free one), and 0 takes any free one")
            ->expected(0, 1)
            ->type_name("[PORT]");
    const auto json = std::make_shared<bool>(false);
    command->add_flag("--json", *json,
                      "Print progress and results on stdout as JSON lines; the table then goes to stderr");
    command->footer(
        "Examples:\n"
        "  gsapp train path/to/scene -m output/scene --eval        # measured on every 8th view\n"
        "  gsapp train path/to/scene --time-limit 5m --size-limit 20MB\n"
        "  gsapp train -m output/scene --resume                    # after an interruption");
    command->callback([=, &selected] {
        selected = [=] {
            TrainOptions options = arguments->resolve();
            options.json = *json;
            std::optional<LiveView> live;
            if (view_option->count() > 0) live = LiveView{port_of(*view)};
            const auto group = RankGroup::join(num_local_ranks(options), "train " + options.model);
            if (group && group->rank() > 0) return follow_training(*group, options);
            if (group) {
                choose_device(*group, options.device);
                agree_on_options(*group, options);
                options.threads = threads_of_rank(*group, options.threads);
            }
            const auto train = [&](const TrainOptions& one) {
                return train_run(one, *frame_rounds, live, group.get());
            };
            if (*num_runs > 0)
                print_table(train_seeds(options, *num_runs, train), options);
            else if (const auto result = train(options))
                print_table({*result}, options);
        };
    });
}

}  // namespace gs
