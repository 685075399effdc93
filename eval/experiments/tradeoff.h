// SPDX-License-Identifier: Apache-2.0
// Speed for accuracy: trained configurations, which of them no other beats, and which to take.
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

/// Numbers to be made small: minus the quality, and the costs. No NaN.
using Objectives = std::array<double, 4>;

/// Whether `a` is no worse than `b` in everything and better in something.
bool dominates(const Objectives& a, const Objectives& b);

/// Returns for each point whether no other one dominates it. Equal points do not dominate each other.
std::vector<bool> pareto_front(const std::vector<Objectives>& points);

/// Returns the indices, ascending, of the better half (rounded up): the frontier, then the frontier of the rest, and so
/// on. From the first frontier that does not fit as a whole it takes the points that lie farthest from their neighbours
/// (crowding distance), so that the ends and the spread of this frontier remain.
std::vector<std::size_t> better_half(const std::vector<Objectives>& points);

enum class Quality { kPsnr, kSsim };

/// What became of a configuration.
enum class RunState { kNotReached, kFinished, kFailed, kStopped, kNoTime };

struct TradeoffRun {
    Configuration configuration;
    RunState state = RunState::kNotReached;
    std::optional<RunResult> result = {};  ///< where finished
    std::string error = {};                ///< where failed
};

struct Tradeoff {
    std::string source;
    std::vector<TradeoffAxis> axes;
    Quality quality = Quality::kPsnr;
    double give_up = 1;  ///< how much worse than the best a recommendation may be, in units of the quality
    std::vector<TradeoffRun> runs;
    std::vector<std::string> remarks;  ///< what else a reader has to know, one sentence each
};

/// Returns "PSNR" or "SSIM".
std::string quality_name(Quality quality);
double quality_of(const RunResult& result, Quality quality);

/// The indices of the finished runs, each list by falling quality.
struct Ranking {
    std::vector<std::size_t> frontier;  ///< no other dominates these in quality, training time, frame time and bytes
    std::vector<std::size_t> dominated;
};
Ranking rank_runs(const Tradeoff& tradeoff);

/// Returns those of these finished runs that are worth a longer training: better_half over quality, training time,
/// frame time and bytes.
std::vector<std::size_t> promoted(const Tradeoff& tradeoff, const std::vector<std::size_t>& runs);

/// One of best, smallest, fastest.
struct Recommendation {
    std::string name;
    std::size_t run;
    std::string text;  ///< what it is, and what it gives up
};

/// Returns the recommendations in the order best, smallest, fastest; none when nothing is finished. best has the
/// highest quality. smallest and fastest have the fewest bytes and the shortest frame among the part of the frontier
/// that is at most `give_up` worse; a better one is preferred where it costs at most 5 % more.
std::vector<Recommendation> recommend(const Tradeoff& tradeoff);

/// Returns text: the table, the recommendations, and what was not trained and why.
std::string format_tradeoff(const Tradeoff& tradeoff, TableStyle style = TableStyle::kMarkdown);

/// Returns the same as an HTML page that needs no other file, with a plot of the quality over each cost.
std::string tradeoff_page(const Tradeoff& tradeoff);

/// Returns all figures as JSON.
std::string tradeoff_json(const Tradeoff& tradeoff);

/// Writes tradeoff.md, tradeoff.html and tradeoff.json to the folder, each atomically. Throws DataError.
void write_tradeoff(const std::filesystem::path& folder, const Tradeoff& tradeoff);

}  // namespace gs
