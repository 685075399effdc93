// SPDX-License-Identifier: Apache-2.0
// Frame times by one protocol, so that runs, models and machines compare.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "eval/pages/text_table.h"
#include "kernels/backend.h"
#include "lib/scene/scene.h"

namespace gs {

struct FrameTimes {
    std::string device;
    int num_views = 0;
    int frames_per_view = 0;
    double mean = 0, median = 0, min = 0, max = 0;  ///< seconds a frame, over the means of the views
};

/// What measure_frame_times does, in one line for readers. Source: the frame time measurement of the paper's supplement.
extern const char* const kFrameProtocol;

/// Times the model that `backend` holds, seen by `cameras` (at least one) at 1280x720 pixels: each has its focal lengths and the centre of
/// its image where they are, so that the picture is cropped or extended. Renders every view once to warm up, then each view once
/// untimed and `frames_per_view` times in a row. Sorting is part of a frame; PPISP and the way to the host are not.
FrameTimes measure_frame_times(Backend& backend, const std::vector<Camera>& cameras, const Vec3<float>& background, int frames_per_view);

/// What was timed, and how long it took.
struct FrameTimesLine {
    std::string run, scene, model;
    std::optional<std::int64_t> num_gaussians;  ///< where it is known
    FrameTimes times;
};

TextTable frame_times_table(const std::vector<FrameTimesLine>& lines);

}  // namespace gs
