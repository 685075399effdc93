// SPDX-License-Identifier: Apache-2.0
// Measures the steps of several ranks that hold one generated set: speed, memory and network traffic.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "eval/bench/bench.h"
#include "eval/pages/text_table.h"
#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/group/rank_group.h"

namespace gs {

/// The measurements of bench_ranks, all from the same steps. Times are in seconds.
struct RankedBenchResult {
    std::string subject;  ///< name of the measured set, for readers
    std::string device;
    std::int64_t num_gaussians = 0;
    int width = 0, height = 0;  ///< size of the views, px
    int views_per_step = 1;
    int steps = 0;
    double seconds = 0;             ///< total of all steps, on rank 0
    std::vector<RankReport> ranks;  ///< reports by rank
    LinkSpeed link;                 ///< link speed of rank 0
    std::string link_name;          ///< link between devices: "NCCL 2.28.3"; empty: splats are copied through the host

    double step_seconds() const { return seconds / steps; }
    double views_per_second() const { return steps * double(views_per_step) / seconds; }
};

/// Measures `bench.repeat` steps on a generated set (eval/bench/bench_cases.h) of `count` Gaussians, distributed over
/// the ranks of `group` (null: this process alone). A step has options.batch views, or as many as there are ranks. As
/// in run_bench, all images are decoded, and learning rates are too small to change the model. The other ranks must be
/// in follow_command.
RankedBenchResult bench_ranks(RankGroup* group, const TrainOptions& options, std::int64_t count,
                              const BenchOptions& bench);

/// Returns a lower bound on the exchange time of a step, s: the largest number of bytes that a rank sends or receives,
/// divided by the bandwidth of the link, plus the latency of each exchange, between hosts or devices. 0 for one rank.
double exchange_floor(const RankedBenchResult& result);

/// Returns the results as text: one line per set, and one per rank of the set.
std::string format_ranked_bench(const std::vector<RankedBenchResult>& results,
                                TableStyle style = TableStyle::kMarkdown);

/// Returns all measurements as one JSON object, times in seconds, bytes and messages summed over the steps.
std::string ranked_bench_json(const std::vector<RankedBenchResult>& results);

}  // namespace gs
