// SPDX-License-Identifier: Apache-2.0
// What each precision costs and how far its frames are from those in double.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/bench/bench.h"
#include "eval/pages/text_table.h"

namespace gs {

struct PrecisionRow {
    std::string name;                    ///< of the level
    double frame_seconds = 0, iteration_seconds = 0;
    std::optional<double> model_bytes = {}; ///< parameters and moments per Gaussian in a GPU's memory
    double mean_error = 0, largest_error = 0; ///< of channels of frames, in steps of 1/255, clamped to [0,1] before
    double psnr = 0;                     ///< of the frames against those in double; infinite where none differs
};

/// Measures `model` on the scene by every level that the device of `options` knows: frames of the test views (of the training views where
/// there are none) and iterations as run_bench does, errors on up to four of those views. One level after another holds the model.
std::vector<PrecisionRow> measure_precision(const TrainOptions& options, const Scene& scene, const Gaussians& model, const BenchOptions& bench);

TextTable precision_table(const std::vector<PrecisionRow>& rows);

}  // namespace gs
