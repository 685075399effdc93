// SPDX-License-Identifier: Apache-2.0
// Two images compared by several metrics, as text and as JSON.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "eval/metrics/metrics.h"

namespace gs {

/// What one metric says about two images.
struct ImageScore {
    MetricInfo metric;
    std::string protocol;  ///< how the metric is computed, in words
    MetricScore score;
};

/// Compares two image files, as 8 bits and with alpha on black, by the metrics of these names (parse_metric_names), one
/// score each in their order. Throws DataError for a file that cannot be read, UsageError for images of different
/// sizes, and what make_metrics throws.
std::vector<ImageScore> compare_images(const std::filesystem::path& render, const std::filesystem::path& truth,
                                       const std::vector<std::string>& metrics, const MetricOptions& options);

/// Returns one line a metric: its value and which values are better, or the reason why there is none.
std::string format_scores(const std::vector<ImageScore>& scores);

/// Returns {"scores": {KEY: number}, "not_measured": {KEY: reason}, "protocol": {NAME: sentence}}. An infinite score
/// becomes null: JSON knows no infinity.
nlohmann::ordered_json scores_json(const std::vector<ImageScore>& scores);

}  // namespace gs
