// SPDX-License-Identifier: Apache-2.0
// Frame times of finished runs and of generated sets, for one table.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "eval/bench/frame_times.h"
#include "eval/runs/saved_run.h"
#include "lib/core/train_options.h"

namespace gs {

/// Opens the run in `folder` at `iteration` (empty: the last saved one), or a point cloud without a run, with the
/// changes `instead`, and times its test views, or its training views where none were held out, by
/// measure_frame_times. Also writes what it measured to the run's results.json. Throws what open_saved_run throws.
FrameTimesLine time_run_frames(const std::string& folder, std::optional<std::int64_t> iteration,
                               const RunChanges& instead, int frames_per_view);

/// Times a generated set (eval/bench/generated_set.h) of `count` Gaussians of the options' appearance. `options` are
/// checked; device, background, seed and the appearance's own options count.
FrameTimesLine time_generated_frames(std::int64_t count, const TrainOptions& options, int frames_per_view);

}  // namespace gs
