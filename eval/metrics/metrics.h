// SPDX-License-Identifier: Apache-2.0
// The metrics by name, with their table properties, and the comparison of two images by several metrics.
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

/// A score, or the reason for a missing score.
struct MetricScore {
    std::optional<double> value;  ///< infinite for the PSNR of identical images
    std::string reason;           ///< "not measured: ..." if there is no value
};

/// The names, direction and precision of a metric for tables.
struct MetricInfo {
    std::string name;  ///< name on the command line, e.g. lpips-vgg
    /// Key in results.json and column heading, e.g. LPIPS-VGG (3DGS writes LPIPS).
    std::string key;
    bool higher_is_better = false;
    int decimals = 4;
};

/// Returns psnr, ssim, lpips-vgg, lpips-alex, flip, dists and milo, in column order.
const std::vector<MetricInfo>& known_metrics();

/// Settings of the metrics.
struct MetricOptions {
    SsimBorder ssim_border = SsimBorder::kValid;
    LpipsRange lpips_range = LpipsRange::kSymmetric;
    double flip_pixels_per_degree = kFlipPixelsPerDegree;
    std::filesystem::path weights;  ///< folder written by scripts/export_metric_weights.py; empty = none
    Device device = Device::kAuto;  ///< device of learned metrics
};

/// A metric ready to be computed.
struct Metric {
    MetricInfo info;
    std::string protocol;  ///< description for results.json, one sentence
    /// Compares two images with 3 channels. Throws UsageError if sizes differ; images that are too small for the metric
    /// return a reason instead of a value.
    std::function<MetricScore(const Image& render, const Image& truth)> compute;
};

/// Creates the named metrics in that order and loads their weights onto the device, those of VGG16 only once. A metric
/// whose files are missing returns that reason instead of a value. Throws DataError naming file and tensor for damaged
/// files, UsageError listing the known metrics for any other name, and DeviceError for kCuda without a device.
std::vector<Metric> make_metrics(const std::vector<std::string>& names, const MetricOptions& options);

/// Splits a list typed by the user, e.g. "psnr,ssim,flip", into names without repetitions in the order of
/// known_metrics(). "all" stands for all of them. Throws UsageError for an unknown name, as make_metrics does, and for
/// an empty list.
std::vector<std::string> parse_metric_names(const std::string& list);

/// Returns the folder of weights: the folder given on the command line, else that of the environment variable
/// GSAPP_METRIC_WEIGHTS, else an empty path. Throws UsageError if the path is not a folder.
std::filesystem::path metric_weights_folder(const std::string& given);

/// The score of two images by one metric.
struct ImageScore {
    MetricInfo metric;
    std::string protocol;  ///< description of the computation
    MetricScore score;
};

/// Compares two image files, converted to 8 bits and with alpha on black, by the named metrics (parse_metric_names).
/// Returns one score per metric, in their order. Throws DataError for a file that cannot be read, UsageError if the
/// sizes of the images differ, and the errors of make_metrics.
std::vector<ImageScore> compare_images(const std::filesystem::path& render, const std::filesystem::path& truth,
                                       const std::vector<std::string>& metrics, const MetricOptions& options);

/// Returns one line per metric: its value and the better direction, or the reason for a missing value.
std::string format_scores(const std::vector<ImageScore>& scores);

/// Returns {"scores": {KEY: number}, "not_measured": {KEY: reason}, "protocol": {NAME: sentence}}. An infinite score
/// becomes null, because JSON has no infinity.
nlohmann::ordered_json scores_json(const std::vector<ImageScore>& scores);

}  // namespace gs
