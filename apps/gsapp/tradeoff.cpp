// SPDX-License-Identifier: Apache-2.0
// `gsapp tradeoff`: trains configurations of one scene and says which of them are worth their cost.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>

#include "apps/gsapp/command.h"
#include "eval/experiments/cell_runner.h"
#include "eval/experiments/time_plan.h"
#include "eval/experiments/tradeoff.h"
#include "eval/experiments/tradeoff_rounds.h"
#include "lib/core/duration.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/options_cli.h"
#include "lib/train/scene_options.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

struct TradeoffArguments {
    std::vector<std::string> axes;
    std::string search = "grid", quality = "psnr", time_limit;
    std::optional<double> give_up;
};

double default_give_up(Quality quality) { return quality == Quality::kPsnr ? 1.0 : 0.02; }

/// What would make every single run fail is an error; what makes a budget none is a remark.
void check_before_training(Tradeoff& tradeoff, const Rounds& rounds, bool overwrite) {
    for (const auto& round : rounds)
        for (const Configuration& configuration : round)
            if (const std::string difference = overwrite ? "" : difference_to_run(configuration.options); !difference.empty())
                throw UsageError(fmt::format("{} holds a run of other options ({}); choose another -m FOLDER, or give --overwrite",
                                             configuration.options.model, difference));
    const Scene scene = load_scene(scene_options(rounds[0][0].options));
    if (scene.test.empty()) throw DataError(fmt::format("{}: there are no test views to measure quality on ({})", scene.source, scene.split_rule));
    const auto points = std::int64_t(scene.points.positions.size());
    const auto below = std::count_if(rounds[0].begin(), rounds[0].end(), [&](const Configuration& c) { return c.options.cap_max < points; });
    if (below == 0) return;
    tradeoff.remarks.push_back(fmt::format("{} of {} configurations have a --cap-max below the {} points that the scene begins with; training keeps these, "
                                           "so that they do not become smaller. A higher --cap-max makes the budget a limit.",
                                           below, rounds[0].size(), points));
    log_warning("{}", tradeoff.remarks.back());
}

class Search {
  public:
    Search(Tradeoff& tradeoff, fs::path folder, std::optional<Clock::time_point> deadline) : tradeoff_(tradeoff), folder_(std::move(folder)), deadline_(deadline) {}

    CellsSummary run(const Rounds& rounds) {
        std::vector<std::size_t> chosen(rounds[0].size()); // indices within a round
        for (std::size_t i = 0; i < chosen.size(); ++i) chosen[i] = i;
        for (std::size_t r = 0; r < rounds.size(); ++r) {
            const std::size_t first = tradeoff_.runs.size();
            for (const std::size_t i : chosen) tradeoff_.runs.push_back({.configuration = rounds[r][i]});
            train(first);
            std::vector<std::size_t> finished;
            bool complete = true; // but for failures, which another length would not mend
            for (std::size_t k = first; k < tradeoff_.runs.size(); ++k) {
                if (tradeoff_.runs[k].result) finished.push_back(k);
                complete = complete && (tradeoff_.runs[k].result || tradeoff_.runs[k].state == RunState::kFailed);
            }
            if (finished.empty() || r + 1 == rounds.size()) break;
            if (!complete) {
                tradeoff_.remarks.push_back(
                    fmt::format("The search ended in round {} of {}, before the better half was chosen for longer trainings.", r + 1, rounds.size()));
                break;
            }
            std::vector<std::size_t> next;
            for (const std::size_t k : promoted(tradeoff_, finished)) next.push_back(chosen[k - first]);
            chosen = next;
        }
        return summary_;
    }

  private:
    /// Trains the runs from `first` on.
    void train(std::size_t first) {
        std::vector<Cell> cells;
        for (std::size_t k = first; k < tradeoff_.runs.size(); ++k) {
            const Configuration& configuration = tradeoff_.runs[k].configuration;
            cells.push_back({configuration_name(tradeoff_.axes, configuration), configuration.options});
        }
        write_tradeoff(folder_, tradeoff_);
        CellHooks hooks;
        hooks.deadline = deadline_;
        hooks.choose = [&](const std::vector<std::size_t>& pending) { return choose(pending, cells); };
        hooks.done = [&](std::size_t k, const CellOutcome& outcome) { finish(tradeoff_.runs[first + k], outcome); };
        const CellsSummary summary = run_cells(cells, hooks);
        if (summary_.num_failed == 0) summary_.first_code = summary.first_code;
        summary_.num_failed += summary.num_failed;
        summary_.interrupted = summary.interrupted;
        if (summary.interrupted) return;
        for (std::size_t k = first; k < tradeoff_.runs.size(); ++k)
            if (tradeoff_.runs[k].state == RunState::kNotReached) tradeoff_.runs[k].state = RunState::kNoTime;
    }

    /// The first that is expected to end in time.
    std::optional<std::size_t> choose(const std::vector<std::size_t>& pending, const std::vector<Cell>& cells) const {
        if (!deadline_) return pending.front();
        const double left = std::chrono::duration<double>(*deadline_ - Clock::now()).count();
        for (const std::size_t k : pending)
            if (plan_.fits(cells[k].options, left)) return k;
        return std::nullopt;
    }

    void finish(TradeoffRun& run, const CellOutcome& outcome) {
        run.result = outcome.result;
        run.error = outcome.error;
        if (outcome.result)
            run.state = RunState::kFinished;
        else if (!outcome.error.empty())
            run.state = RunState::kFailed;
        else if (deadline_ && Clock::now() >= *deadline_)
            run.state = RunState::kStopped;
        if (outcome.result) plan_.add(run.configuration.options, outcome.result->train_seconds, outcome.wall_seconds);
        if (outcome.wall_seconds) write_tradeoff(folder_, tradeoff_); // those that were finished before are shown with the first that was not
    }

    Tradeoff& tradeoff_;
    const fs::path folder_;
    const std::optional<Clock::time_point> deadline_;
    TimePlan plan_;
    CellsSummary summary_;
};

void run_tradeoff(TrainOptions base, const TradeoffArguments& arguments) {
    const auto begin = Clock::now();
    if (!base.resume.empty()) throw UsageError("tradeoff: runs are not resumed; the same command again trains those that are missing");
    if (base.model.empty()) base.model = (fs::path("output") / (scene_name(base.source) + "-tradeoff")).string();
    std::optional<Clock::time_point> deadline;
    if (!arguments.time_limit.empty())
        deadline = begin + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(parse_duration(arguments.time_limit, "--time-limit")));
    Tradeoff tradeoff;
    tradeoff.source = base.source;
    tradeoff.quality = arguments.quality == "psnr" ? Quality::kPsnr : Quality::kSsim;
    tradeoff.give_up = arguments.give_up.value_or(default_give_up(tradeoff.quality));
    const Rounds rounds = (arguments.search == "grid" ? plan_grid : plan_halving)(arguments.axes, base, tradeoff.axes);
    check_before_training(tradeoff, rounds, base.overwrite);

    const fs::path folder = base.model;
    catch_interrupts();
    const CellsSummary summary = Search(tradeoff, folder, deadline).run(rounds);
    write_tradeoff(folder, tradeoff);
    std::fputs(format_tradeoff(tradeoff).c_str(), stdout);
    throw_unless_complete(summary, tradeoff.runs.size(), folder / "tradeoff.md");
    std::size_t finished = 0;
    for (const TradeoffRun& run : tradeoff.runs) finished += run.result.has_value();
    if (finished == 0) throw UsageError(fmt::format("--time-limit {}: too short for even one of these runs", arguments.time_limit));
    log_info("{} of {} configurations trained in {}; the same with plots: {}", finished, tradeoff.runs.size(),
                 duration_text(std::chrono::duration<double>(Clock::now() - begin).count()), (folder / "tradeoff.html").string());
    if (finished < tradeoff.runs.size()) log_warning("the time limit left out {}; the same command trains them", tradeoff.runs.size() - finished);
}

}  // namespace

void add_tradeoff_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand(
        "tradeoff", "Train configurations of a scene, one at a time or one on each GPU, and show what speed, size and quality each gives; finished "
                    "ones in -m FOLDER are kept");
    const auto train = std::make_shared<TrainArguments>(*command);
    const auto arguments = std::make_shared<TradeoffArguments>();
    command->add_option("--axes", arguments->axes,
                        "What is varied: NAME=VALUE,VALUE ..., a training option or budget (share of --cap-max); a NAME alone takes default values "
                        "(default: appearance budget iterations)");
    command->add_option("--search", arguments->search,
                        "grid: every combination; halving: all at a quarter of --iterations, the better half at a half, the better half of these at all")
        ->check(CLI::IsMember({"grid", "halving"}))
        ->capture_default_str();
    command->add_option("--time-limit", arguments->time_limit, "Start nothing that would not end in that time, e.g. 20m, 90s, 2h; stop what has not")
        ->type_name("TIME");
    command->add_option("--quality", arguments->quality, "Measure of quality")->check(CLI::IsMember({"psnr", "ssim"}))->capture_default_str();
    command->add_option("--give-up", arguments->give_up, "What smallest and fastest may give up against the best (default: 1 dB, or 0.02 of SSIM)")
        ->check(CLI::Range(0.0, 1000.0));
    command->callback([train, arguments, &selected] {
        selected = [train, arguments] {
            const TrainOptions base = train->combine();
            setup_log(shown_messages(base));
            run_tradeoff(base, *arguments);
        };
    });
}

}  // namespace gs
