// SPDX-License-Identifier: Apache-2.0
// Implements the frame time protocol and its table.
#include "eval/bench/frame_times.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "eval/bench/bench.h"
#include "lib/core/json_text.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/resized.h"

namespace gs {

const char* const kFrameProtocol =
    "frame times at 1280x720 pixels with the views' own focal lengths (cropped or extended, not rescaled); after a "
    "warm-up each view is rendered "
    "many times in a row; mean, median, least and most over the means of the views; with sorting, without PPISP and "
    "the way to the host";

FrameTimes measure_frame_times(Backend& backend, const std::vector<Camera>& cameras, const Vec3<float>& background,
                               int frames_per_view) {
    std::vector<RenderRequest> requests(cameras.size());
    RenderedImage warm_up;
    for (std::size_t k = 0; k < cameras.size(); ++k) {
        requests[k].camera = camera_params(with_size(cameras[k], kFrameWidth, kFrameHeight));
        requests[k].background = background;
        backend.render(requests[k], warm_up);
    }
    std::vector<double> seconds;
    for (const RenderRequest& request : requests) seconds.push_back(backend.time_frames({request}, frames_per_view));
    std::sort(seconds.begin(), seconds.end());
    FrameTimes times{backend.describe(), int(seconds.size()), frames_per_view};
    for (const double s : seconds) times.mean += s / double(seconds.size());
    times.median = (seconds[(seconds.size() - 1) / 2] + seconds[seconds.size() / 2]) / 2;
    times.min = seconds.front(), times.max = seconds.back();
    return times;
}

TextTable frame_times_table(const std::vector<FrameTimesLine>& lines) {
    TextTable table;
    table.header = {"run",           "scene",   "model",     "device", "#Gs",   "views",
                    "frames a view", "mean ms", "median ms", "min ms", "max ms"};
    table.num_labels = 4;
    const auto milliseconds = [](double seconds) { return TextCell{fmt::format("{:.3f}", 1e3 * seconds)}; };
    for (const FrameTimesLine& line : lines) {
        const FrameTimes& t = line.times;
        table.lines.push_back({{line.run},
                               {line.scene},
                               {line.model},
                               {t.device},
                               {line.num_gaussians ? fmt::format("{}", *line.num_gaussians) : "-"},
                               {fmt::format("{}", t.num_views)},
                               {fmt::format("{}", t.frames_per_view)},
                               milliseconds(t.mean),
                               milliseconds(t.median),
                               milliseconds(t.min),
                               milliseconds(t.max)});
    }
    return table;
}

std::string frame_times_json(const std::vector<FrameTimesLine>& lines) {
    nlohmann::ordered_json json = {{"protocol", kFrameProtocol}, {"lines", nlohmann::ordered_json::array()}};
    for (const FrameTimesLine& line : lines) {
        const FrameTimes& t = line.times;
        json["lines"].push_back({{"run", line.run},
                                 {"scene", line.scene},
                                 {"model", line.model},
                                 {"device", t.device},
                                 {"num_gaussians", nullptr},
                                 {"num_views", t.num_views},
                                 {"frames_per_view", t.frames_per_view},
                                 {"mean_seconds", t.mean},
                                 {"median_seconds", t.median},
                                 {"min_seconds", t.min},
                                 {"max_seconds", t.max}});
        if (line.num_gaussians) json["lines"].back()["num_gaussians"] = *line.num_gaussians;
    }
    return json_text(json, 1) + "\n";
}

}  // namespace gs
