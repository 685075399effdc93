// SPDX-License-Identifier: Apache-2.0
// The metrics by name, each with what a table needs to know of it.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "eval/metrics/flip.h"
#include "eval/metrics/lpips.h"
#include "eval/metrics/ssim.h"
#include "lib/core/choices.h"

namespace gs {

/// A number, or why there is none.
struct MetricScore {
    std::optional<double> value;  ///< infinite for the PSNR of identical images
    std::string reason;           ///< "not measured: ..." where there is no value
};

struct MetricInfo {
    std::string name;  ///< on the command line: lpips-vgg
    std::string key;   ///< in results.json, and the heading of its column: LPIPS-VGG (3DGS writes LPIPS)
    bool higher_is_better = false;
    int decimals = 4;
};

/// psnr, ssim, lpips-vgg, lpips-alex, flip, dists, milo: the order of columns.
const std::vector<MetricInfo>& known_metrics();

struct MetricOptions {
    SsimBorder ssim_border = SsimBorder::kValid;
    LpipsRange lpips_range = LpipsRange::kSymmetric;
    double flip_pixels_per_degree = kFlipPixelsPerDegree;
    std::filesystem::path weights;  ///< folder that scripts/export_metric_weights.py wrote; empty = none
    Device device = Device::kAuto;  ///< that learned metrics compute on
};

struct Metric {
    MetricInfo info;
    std::string protocol;  ///< one sentence for results.json
    /// Of two images with 3 channels. Throws UsageError when sizes differ; images too small for the metric are a reason.
    std::function<MetricScore(const Image& render, const Image& truth)> compute;
};

/// The named metrics, in that order, their weights loaded to the device (VGG16's once). Where files of weights are missing a metric answers
/// with that reason; damaged ones throw DataError naming file and tensor. Throws UsageError naming the known ones for another name,
/// DeviceError for kCuda without a device.
std::vector<Metric> make_metrics(const std::vector<std::string>& names, const MetricOptions& options);

/// The names in a list as typed, "psnr,ssim,flip", without repetitions and in the order of known_metrics(). "all" stands for
/// all of them. Throws UsageError as make_metrics, and for an empty list.
std::vector<std::string> parse_metric_names(const std::string& list);

/// The folder of weights: as given on the command line, else the environment variable GSAPP_METRIC_WEIGHTS, else empty. Throws
/// UsageError when it is no folder.
std::filesystem::path metric_weights_folder(const std::string& given);

}  // namespace gs
