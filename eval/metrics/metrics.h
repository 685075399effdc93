// SPDX-License-Identifier: Apache-2.0
// The metrics by name, each with the facts that a table needs, and two images compared by several of them.
#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "eval/metrics/flip.h"
#include "eval/metrics/learned_metrics.h"
#include "eval/metrics/pixel_metrics.h"
#include "lib/core/choices.h"

namespace gs {

/// A score, or the reason why there is none.
struct MetricScore {
    std::optional<double> value;  ///< infinite for the PSNR of identical images
    std::string reason;           ///< "not measured: ..." if there is no value
};

/// The names, direction and precision of a metric in tables.
struct MetricInfo {
    std::string name;  ///< word on the command line, e.g. lpips-vgg
    std::string key;   ///< key in results.json and heading of its column, e.g. LPIPS-VGG (3DGS writes LPIPS)
    bool higher_is_better = false;
    int decimals = 4;
};

/// Returns psnr, ssim, lpips-vgg, lpips-alex, flip, dists and milo, in the order of their columns.
const std::vector<MetricInfo>& known_metrics();

/// The choices that metrics leave open.
struct MetricOptions {
    SsimBorder ssim_border = SsimBorder::kValid;
    LpipsRange lpips_range = LpipsRange::kSymmetric;
    double flip_pixels_per_degree = kFlipPixelsPerDegree;
    std::filesystem::path weights;  ///< folder that scripts/export_metric_weights.py wrote; empty = none
    Device device = Device::kAuto;  ///< device of learned metrics
};

/// A metric ready to be computed.
struct Metric {
    MetricInfo info;
    std::string protocol;  ///< one sentence for results.json
    /// Compares two images with 3 channels. Throws UsageError when sizes differ; images that are too small for the
    /// metric give a reason instead of a value.
    std::function<MetricScore(const Image& render, const Image& truth)> compute;
};

/// Makes the named metrics in that order and loads their weights to the device, those of VGG16 once. A metric whose
/// files are missing answers with that reason. Throws DataError naming file and tensor for damaged files, UsageError
/// naming the known metrics for another name, and DeviceError for kCuda without a device.
std::vector<Metric> make_metrics(const std::vector<std::string>& names, const MetricOptions& options);

/// Splits a list as typed, e.g. "psnr,ssim,flip", into names without repetitions in the order of known_metrics(). "all"
/// stands for all of them. Throws UsageError for an unknown name, as make_metrics does, and for an empty list.
std::vector<std::string> parse_metric_names(const std::string& list);

/// Returns the folder of weights: the one given on the command line, else that of the environment variable
/// GSAPP_METRIC_WEIGHTS, else an empty path. Throws UsageError when it is no folder.
std::filesystem::path metric_weights_folder(const std::string& given);

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
