// SPDX-License-Identifier: Apache-2.0
// Measures frame times by one protocol, so that runs, models and machines compare.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "eval/pages/text_table.h"
#include "kernels/ranks/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// The times of a model's frames.
struct FrameTimes {
    std::string device;
    int num_views = 0;
    int frames_per_view = 0;
    double mean = 0, median = 0, min = 0, max = 0;  ///< seconds a frame: statistics of the means of the views
};

/// The protocol of measure_frame_times in one line for readers. Source: the frame time measurement of the paper's
/// supplement.
extern const char* const kFrameProtocol;

/// Times the model that `backend` holds, seen by `cameras` (at least one) at 1280x720 pixels. Each camera keeps its
/// focal lengths and the centre of its image, so that the picture is cropped or extended. Renders every view once to
/// warm up, then each view once untimed and `frames_per_view` times in a row. Sorting is part of a frame; PPISP and the
/// copy to the host are not.
FrameTimes measure_frame_times(Backend& backend, const std::vector<Camera>& cameras, const Vec3<float>& background,
                               int frames_per_view);

/// One line of the table: the run and its times.
struct FrameTimesLine {
    std::string run, scene, model;
    std::optional<std::int64_t> num_gaussians;  ///< empty if it is not known
    FrameTimes times;
};

/// Returns a table with times in milliseconds.
TextTable frame_times_table(const std::vector<FrameTimesLine>& lines);

/// Returns the same and the protocol as JSON, with times in seconds.
std::string frame_times_json(const std::vector<FrameTimesLine>& lines);

}  // namespace gs
