// SPDX-License-Identifier: Apache-2.0
// Reads two images, computes the metrics, writes what they say.
#include "eval/metrics/compare_images.h"

#include <fmt/format.h>

#include <cmath>

#include "eval/metrics/psnr.h"
#include "eval/metrics/quantize.h"
#include "kernels/base/error.h"

namespace gs {

using Json = nlohmann::ordered_json;

std::vector<ImageScore> compare_images(const std::filesystem::path& render, const std::filesystem::path& truth,
                                       const std::vector<std::string>& metrics, const MetricOptions& options) {
    const Image a = quantized_target(read_image(render), {0, 0, 0}), b = quantized_target(read_image(truth), {0, 0, 0});
    if (a.width != b.width || a.height != b.height)
        throw UsageError(fmt::format("images to compare must be of one size: {} is {}x{}, {} is {}x{}", render.string(),
                                     a.width, a.height, truth.string(), b.width, b.height));
    std::vector<ImageScore> scores;
    for (const Metric& metric : make_metrics(metrics, options))
        scores.push_back({metric.info, metric.protocol, metric.compute(a, b)});
    return scores;
}

std::string format_scores(const std::vector<ImageScore>& scores) {
    std::string text;
    for (const auto& [metric, protocol, score] : scores)
        text += score.value ? fmt::format("{:<10} {:>9.{}f}  {} is better; {}\n", metric.key, *score.value,
                                          metric.decimals, metric.higher_is_better ? "higher" : "lower", protocol)
                            : fmt::format("{:<10} {}\n", metric.key, score.reason);
    return text;
}

Json scores_json(const std::vector<ImageScore>& scores) {
    Json json = {{"scores", Json::object()}, {"not_measured", Json::object()}};
    for (const auto& [metric, protocol, score] : scores) {
        if (score.value)
            json["scores"][metric.key] = std::isfinite(*score.value) ? Json(*score.value) : Json(nullptr);
        else
            json["not_measured"][metric.key] = score.reason;
        json["protocol"][metric.name] = protocol;
    }
    return json;
}

}  // namespace gs
