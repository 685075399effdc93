// SPDX-License-Identifier: Apache-2.0
// `gsapp tradeoff`: trains configurations of one scene and recommends those worth their cost.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>

#include "apps/gsapp/command.h"
#include "apps/gsapp/printing.h"
#include "apps/gsapp/train/train_run.h"
#include "eval/experiments/tradeoff_search.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/options_cli.h"
#include "lib/core/quantities.h"

namespace gs {
namespace {

using Clock = std::chrono::steady_clock;

struct TradeoffArguments {
    std::vector<std::string> axes;
    std::string search = "grid", quality = "psnr", time_limit;
    std::optional<double> give_up;
    bool json = false;
};

void run_tradeoff(const TrainOptions& base, const TradeoffArguments& arguments) {
    const auto begin = Clock::now();
    std::optional<Clock::time_point> deadline;
    if (!arguments.time_limit.empty())
        deadline = begin + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(
                               parse_duration(arguments.time_limit, "--time-limit").seconds));
    TradeoffPlan plan =
        plan_tradeoff(base, {.axes = arguments.axes,
                             .search = arguments.search == "grid" ? SearchKind::kGrid : SearchKind::kHalving,
                             .quality = arguments.quality == "psnr" ? Quality::kPsnr : Quality::kSsim,
                             .give_up = arguments.give_up});
    for (const std::string& remark : plan.tradeoff.remarks) log_warning("{}", remark);
    catch_interrupts();
    const JobsSummary summary = search_tradeoff(plan, deadline);
    const std::vector<TradeoffRun>& runs = plan.tradeoff.runs;
    std::fputs((arguments.json ? tradeoff_json(plan.tradeoff) : format_tradeoff(plan.tradeoff, stdout_style())).c_str(),
               stdout);
    throw_unless_complete(summary, runs.size(), plan.folder / "tradeoff.md");
    const auto finished = std::size_t(
        std::count_if(runs.begin(), runs.end(), [](const TradeoffRun& run) { return run.result.has_value(); }));
    if (finished == 0)
        throw UsageError(fmt::format("--time-limit {}: too short for even one of these runs", arguments.time_limit));
    log_info("{} of {} configurations trained in {}; the same with plots: {}", finished, runs.size(),
             duration_text(std::chrono::duration<double>(Clock::now() - begin).count()),
             (plan.folder / "tradeoff.html").string());
    if (finished < runs.size())
        log_warning("the time limit left out {}; the same command trains them", runs.size() - finished);
}

}  // namespace

void add_tradeoff_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand("tradeoff",
                                           "Train configurations of a scene, one at a time or one on each GPU, and "
                                           "show what speed, size and quality each gives; finished "
                                           "ones in -m FOLDER are kept");
    const auto train = std::make_shared<TrainArguments>(*command, "time-limit");
    const auto arguments = std::make_shared<TradeoffArguments>();
    command->add_option("--axes", arguments->axes,
                        "What is varied: NAME=VALUE,VALUE ..., a training option or budget (share of --cap-max); a "
                        "NAME alone takes default values "
                        "(default: appearance budget iterations)");
    command
        ->add_option("--search", arguments->search,
                     "grid: every combination; halving: all at a quarter of --iterations, the better half at a half, "
                     "the better half of these at all")
        ->check(CLI::IsMember({"grid", "halving"}))
        ->capture_default_str();
    command
        ->add_option("--time-limit", arguments->time_limit,
                     "Start nothing that would not end in that time, such as 20m or 2h; stop what has not")
        ->type_name("TIME");
    command->add_option("--quality", arguments->quality, "Measure of quality")
        ->check(CLI::IsMember({"psnr", "ssim"}))
        ->capture_default_str();
    command
        ->add_option("--give-up", arguments->give_up,
                     "What smallest and fastest may give up against the best (default: 1 dB, or 0.02 of SSIM)")
        ->check(CLI::Range(0.0, 1000.0));
    add_json_flag(*command, arguments->json);
    command->callback([train, arguments, &selected] {
        selected = [train, arguments] {
            const TrainOptions base = train->combine();
            setup_log(shown_messages(base));
            run_tradeoff(base, *arguments);
        };
    });
}

}  // namespace gs
