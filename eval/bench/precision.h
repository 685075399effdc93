// SPDX-License-Identifier: Apache-2.0
// Measures the cost of each precision and the distance of its frames from those in double.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/bench/bench.h"
#include "eval/pages/text_table.h"

namespace gs {

/// The measurements of one level.
struct PrecisionRow {
    std::string name;  ///< name of the level
    double frame_seconds = 0, iteration_seconds = 0;
    std::optional<double> model_bytes = {};    ///< parameters and moments per Gaussian in a GPU's memory
    double mean_error = 0, largest_error = 0;  ///< errors of channels clamped to [0,1], in steps of 1/255
    double psnr = 0;                           ///< dB, frames against those in double; infinite where none differs
};

/// Measures `model` on the scene at every level that the device of `options` supports, one level after another. Frames
/// of the test views (of the training views where there are none) and iterations are timed as run_bench does; errors
/// are measured on up to four of those views.
std::vector<PrecisionRow> measure_precision(const TrainOptions& options, const Scene& scene, const Gaussians& model,
                                            const BenchOptions& bench);

/// Returns a table with times in milliseconds.
TextTable precision_table(const std::vector<PrecisionRow>& rows);

/// Returns the same as JSON, with the name of what was measured and times in seconds; null for an infinite PSNR.
std::string precision_json(const std::string& subject, const std::vector<PrecisionRow>& rows);

}  // namespace gs
