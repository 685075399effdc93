// SPDX-License-Identifier: Apache-2.0
// `gsapp bench --frames`.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "lib/core/train_options.h"

namespace gs {

struct FramesArguments {
    std::vector<std::string> runs;         ///< folders; what is measured is also written to their results.json
    std::optional<std::int64_t> iteration; ///< of the runs; empty: the last saved one
    std::vector<std::int64_t> generate;    ///< sizes of generated sets, each timed once for every one of `appearances`
    std::vector<std::string> appearances;
    int frames_per_view = 0;
};

/// Prints one table of frame times (eval/bench/frame_times.h). Of `options`, which are checked, the device counts, and for generated sets
/// background, seed and the options of appearances. Throws what opening a run throws.
void run_frames(const FramesArguments& arguments, const TrainOptions& options);

}  // namespace gs
