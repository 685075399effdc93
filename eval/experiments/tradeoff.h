// SPDX-License-Identifier: Apache-2.0
// Trade-off of speed and accuracy: trained configurations, their Pareto front, and recommendations.
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/experiments/job.h"
#include "eval/experiments/tradeoff_axes.h"
#include "eval/pages/text_table.h"

namespace gs {

/// Values to minimize: the negated quality, and the costs. No NaN.
using Objectives = std::array<double, 4>;

/// Returns whether `a` is no worse than `b` in every objective and better in at least one.
bool dominates(const Objectives& a, const Objectives& b);

/// Returns for each point whether no other point dominates it. Equal points do not dominate each other.
std::vector<bool> pareto_front(const std::vector<Objectives>& points);

/// Returns the indices, ascending, of the better half (rounded up): the Pareto front, then the front of the remaining
/// points, and so on. From the first front that does not fit completely, takes the points farthest from their
/// neighbours (crowding distance), so that the ends and the spread of this front are kept.
std::vector<std::size_t> better_half(const std::vector<Objectives>& points);

enum class Quality { kPsnr, kSsim };

/// The outcome of a configuration.
enum class RunState { kNotReached, kFinished, kFailed, kStopped, kNoTime };

struct TradeoffRun {
    Configuration configuration;
    RunState state = RunState::kNotReached;
    std::optional<RunResult> result = {};  ///< set if finished
    std::string error = {};                ///< message if failed
};

struct Tradeoff {
    std::string source;
    std::vector<TradeoffAxis> axes;
    Quality quality = Quality::kPsnr;
    double give_up = 1;  ///< largest loss of quality, relative to the best run, that a recommendation may have
    std::vector<TradeoffRun> runs;
    std::vector<std::string> remarks;  ///< further remarks for readers, one sentence each
};

/// Returns "PSNR" or "SSIM".
std::string quality_name(Quality quality);
double quality_of(const RunResult& result, Quality quality);

/// The indices of the finished runs, each list in descending order of quality.
struct Ranking {
    std::vector<std::size_t> frontier;  ///< runs not dominated in quality, training time, frame time and bytes
    std::vector<std::size_t> dominated;
};
Ranking rank_runs(const Tradeoff& tradeoff);

/// Returns the runs, out of the finished `runs`, that deserve a longer training: better_half over quality, training
/// time, frame time and bytes.
std::vector<std::size_t> promoted(const Tradeoff& tradeoff, const std::vector<std::size_t>& runs);

/// One recommendation: best, smallest or fastest.
struct Recommendation {
    std::string name;
    std::size_t run;
    std::string text;  ///< description of the run, and its losses against the others
};

/// Returns the recommendations in the order best, smallest, fastest; none if no run has finished. "best" has the
/// highest quality. "smallest" and "fastest" have the fewest bytes and the shortest frame time on the part of the
/// frontier that is at most `give_up` worse; a run of higher quality is preferred if it costs at most 5 % more.
std::vector<Recommendation> recommend(const Tradeoff& tradeoff);

/// Returns as text the table, the recommendations, and the untrained configurations with reasons.
std::string format_tradeoff(const Tradeoff& tradeoff, TableStyle style = TableStyle::kMarkdown);

/// Returns the same as a self-contained HTML page, with a plot of the quality over each cost.
std::string tradeoff_page(const Tradeoff& tradeoff);

/// Returns all results as JSON.
std::string tradeoff_json(const Tradeoff& tradeoff);

/// Writes tradeoff.md, tradeoff.html and tradeoff.json to the folder, each atomically. Throws DataError.
void write_tradeoff(const std::filesystem::path& folder, const Tradeoff& tradeoff);

}  // namespace gs
