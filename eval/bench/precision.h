// SPDX-License-Identifier: Apache-2.0
// Named levels of accuracy and speed. Measures the cost of each level, and the error of its frames against frames in
// double.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/bench/bench.h"
#include "eval/pages/text_table.h"
#include "lib/core/train_options.h"

namespace gs {

/// One level and the options that it changes.
struct PrecisionLevel {
    std::string name;
    bool gpu_only;
    void (*apply)(TrainOptions&);  ///< changes the options that still have the default precision
};

/// Returns all levels; the first one is the default.
const std::vector<PrecisionLevel>& precision_levels();

/// Returns the level with this name. Throws UsageError listing the known names for any other name.
const PrecisionLevel& precision_level(const std::string& name);

/// The measurements of one level.
struct PrecisionRow {
    std::string name;  ///< name of the level
    double frame_seconds = 0, iteration_seconds = 0;
    std::optional<double> model_bytes = {};    ///< parameters and moments per Gaussian in GPU memory
    double mean_error = 0, largest_error = 0;  ///< errors of channels clamped to [0,1], in units of 1/255
    double psnr = 0;                           ///< dB, against frames in double; infinite if all are equal
};

/// Measures `model` on the scene at every level that the device of `options` supports, one level after another.
/// Times iterations, and frames of the test views (training views if there are none), as in run_bench; errors are
/// measured on up to four of those views.
std::vector<PrecisionRow> measure_precision(const TrainOptions& options, const Scene& scene, const Gaussians& model,
                                            const BenchOptions& bench);

/// Returns a table with times in milliseconds.
TextTable precision_table(const std::vector<PrecisionRow>& rows);

/// Returns the rows as JSON, with the name of the measured subject and times in seconds; null for an infinite PSNR.
std::string precision_json(const std::string& subject, const std::vector<PrecisionRow>& rows);

}  // namespace gs
