// SPDX-License-Identifier: Apache-2.0
// Runs the rounds of a search, predicts times, and chooses the next job that fits the remaining time.
#include "eval/experiments/tradeoff_search.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "lib/core/options.h"
#include "lib/core/quantities.h"

namespace gs {
namespace {

using Clock = std::chrono::steady_clock;

class Search {
  public:
    Search(TradeoffPlan& plan, std::optional<Clock::time_point> deadline, const JobsRunner& run_jobs)
        : tradeoff_(plan.tradeoff),
          rounds_(plan.rounds),
          folder_(plan.folder),
          deadline_(deadline),
          run_jobs_(run_jobs) {}

    JobsSummary run() {
        std::vector<std::size_t> chosen(rounds_[0].size());  // indices within a round
        std::iota(chosen.begin(), chosen.end(), std::size_t(0));
        for (std::size_t r = 0; r < rounds_.size(); ++r) {
            const std::size_t first = tradeoff_.runs.size();
            for (const std::size_t i : chosen) tradeoff_.runs.push_back({.configuration = rounds_[r][i]});
            train(first);
            std::vector<std::size_t> finished;
            bool complete = true;  // ignores failures, which a longer training would not fix
            for (std::size_t k = first; k < tradeoff_.runs.size(); ++k) {
                if (tradeoff_.runs[k].result) finished.push_back(k);
                complete = complete && (tradeoff_.runs[k].result || tradeoff_.runs[k].state == RunState::kFailed);
            }
            if (finished.empty() || r + 1 == rounds_.size()) break;
            if (!complete) {
                tradeoff_.remarks.push_back(fmt::format(
                    "The search ended in round {} of {}, before the better half was chosen for longer trainings.",
                    r + 1, rounds_.size()));
                break;
            }
            std::vector<std::size_t> next;
            for (const std::size_t k : promoted(tradeoff_, finished)) next.push_back(chosen[k - first]);
            chosen = next;
        }
        write_tradeoff(folder_, tradeoff_);
        return summary_;
    }

  private:
    /// Trains the runs from `first` on.
    void train(std::size_t first) {
        std::vector<Job> jobs;
        for (std::size_t k = first; k < tradeoff_.runs.size(); ++k) {
            const Configuration& configuration = tradeoff_.runs[k].configuration;
            jobs.push_back({configuration_name(tradeoff_.axes, configuration), configuration.options});
        }
        write_tradeoff(folder_, tradeoff_);
        JobHooks hooks;
        hooks.deadline = deadline_;
        hooks.choose = [&](const std::vector<std::size_t>& pending) { return choose(pending, jobs); };
        hooks.done = [&](std::size_t k, const JobOutcome& outcome) { finish(tradeoff_.runs[first + k], outcome); };
        const JobsSummary summary = run_jobs_(jobs, hooks);
        if (summary_.num_failed == 0) summary_.first_code = summary.first_code;
        summary_.num_failed += summary.num_failed;
        summary_.interrupted = summary.interrupted;
        if (summary.interrupted) return;
        for (std::size_t k = first; k < tradeoff_.runs.size(); ++k)
            if (tradeoff_.runs[k].state == RunState::kNotReached) tradeoff_.runs[k].state = RunState::kNoTime;
    }

    /// Returns the first pending job that is expected to end in time.
    std::optional<std::size_t> choose(const std::vector<std::size_t>& pending, const std::vector<Job>& jobs) const {
        if (!deadline_) return pending.front();
        const double left = std::chrono::duration<double>(*deadline_ - Clock::now()).count();
        for (const std::size_t k : pending)
            if (time_plan_.fits(jobs[k].options, left)) return k;
        return std::nullopt;
    }

    void finish(TradeoffRun& run, const JobOutcome& outcome) {
        run.result = outcome.result;
        run.error = outcome.error;
        if (outcome.result)
            run.state = RunState::kFinished;
        else if (!outcome.error.empty())
            run.state = RunState::kFailed;
        else if (deadline_ && Clock::now() >= *deadline_)
            run.state = RunState::kStopped;
        if (outcome.result)
            time_plan_.add(run.configuration.options, *outcome.result->train_seconds, outcome.wall_seconds);
        if (outcome.wall_seconds) write_tradeoff(folder_, tradeoff_);  // no file for each job that was finished before
    }

    Tradeoff& tradeoff_;
    const Rounds& rounds_;
    const std::filesystem::path& folder_;
    const std::optional<Clock::time_point> deadline_;
    const JobsRunner& run_jobs_;
    TimePlan time_plan_;
    JobsSummary summary_;
};

}  // namespace

void TimePlan::add(const TrainOptions& options, double train_seconds, std::optional<double> wall_seconds) {
    ended_.push_back({options, train_seconds});
    if (wall_seconds) overhead_seconds_ = std::max(overhead_seconds_, *wall_seconds - train_seconds);
}

std::optional<double> TimePlan::seconds(const TrainOptions& options) const {
    if (options.time_limit) return overhead_seconds_ + options.time_limit->seconds;
    std::optional<double> expected;
    double least = std::numeric_limits<double>::infinity();
    for (const Ended& run : ended_) {
        if (!run.options.ends_by_iterations()) continue;
        const double iterations = double(options.iterations) / double(run.options.iterations);
        const double gaussians = double(options.cap_max) / double(run.options.cap_max);
        // A size difference of 1 % outweighs another appearance: the times of appearances differ less than
        // twofold.
        const double distance = std::abs(std::log(iterations)) + std::abs(std::log(gaussians)) +
                                (run.options.appearance == options.appearance ? 0 : 0.01);
        if (distance >= least) continue;
        least = distance;
        expected = overhead_seconds_ + run.train_seconds * iterations * gaussians;
    }
    return expected;
}

JobsSummary search_tradeoff(TradeoffPlan& plan, std::optional<Clock::time_point> deadline, const JobsRunner& run) {
    return Search(plan, deadline, run).run();
}

}  // namespace gs
