// SPDX-License-Identifier: Apache-2.0
// Measures frame times by one protocol, so that runs, models and machines are comparable.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "eval/pages/text_table.h"
#include "kernels/ranks/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// Times of a model's frames.
struct FrameTimes {
    std::string device;
    int num_views = 0;
    int frames_per_view = 0;
    double mean = 0, median = 0, min = 0, max = 0;  ///< seconds per frame: statistics of the views' means
};

/// Description of the protocol of measure_frame_times in one line, for readers. Source: the frame time measurement of
/// the paper's supplement.
extern const char* const kFrameProtocol;

/// Times the model that `backend` holds, from `cameras` (at least one) at 1280x720 pixels. Each camera keeps its focal
/// lengths and its image centre, so that the image is cropped or extended. Renders every view once to warm up, then
/// each view once untimed and `frames_per_view` times in a row. The time includes sorting, but not PPISP or the copy to
/// the host.
FrameTimes measure_frame_times(Backend& backend, const std::vector<Camera>& cameras, const Vec3<float>& background,
                               int frames_per_view);

/// One line of the table: a run and its frame times.
struct FrameTimesLine {
    std::string run, scene, model;
    std::optional<std::int64_t> num_gaussians;  ///< number of Gaussians; empty if not known
    FrameTimes times;
};

/// Returns a table with times in milliseconds.
TextTable frame_times_table(const std::vector<FrameTimesLine>& lines);

/// Returns the frame times and the protocol as JSON, with times in seconds.
std::string frame_times_json(const std::vector<FrameTimesLine>& lines);

}  // namespace gs
