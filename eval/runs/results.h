// SPDX-License-Identifier: Apache-2.0
// Reads and writes the results of a run folder: results.json and per_view.json, with the keys of 3DGS's metrics.py and
// additional fields.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "eval/runs/run_result.h"
#include "lib/core/train_options.h"
#include "lib/model/run_folder.h"

namespace gs {

/// Adds iteration `result.iteration` to results.json and per_view.json and keeps their other iterations. In
/// results.json every field of result_fields() has its place; metrics are stored beside PSNR and SSIM under
/// MetricInfo::key, and "not_measured": {"ours_N": {"LPIPS-VGG": reason}} gives the reason for a missing metric. Values
/// that `result` lacks stay as an earlier evaluation wrote them, except values about the model. The format of
/// per_view.json is
///   {"ours_N": {"SSIM": {"00000.png": ..}, "PSNR": {..}},
///    "decomposition": {"ours_N": {"residual_mean": {"00000.png": ..}}}, "image_names": {"ours_N": {"00000.png": ..}}}
/// The infinite PSNR of identical images is written as null, because JSON has no infinity. Each file is replaced
/// atomically. Throws DataError if an existing file is not a JSON object or cannot be written.
void write_results(const RunFolder& folder, const RunResult& result);

/// Adds "frame_times": {"ours_N": {..}} to results.json, which need not exist. Atomic; throws the errors of
/// write_results.
void write_frame_times(const RunFolder& folder, std::int64_t iteration, const FrameTimes& times);

/// Reads the result of one iteration of a run; if `iteration` is empty, that of the last evaluated one. Also reads
/// files of other programs that use the 3DGS keys. Throws DataError naming file and field.
RunResult read_results(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration);

/// Adds seed and training options from the run's config.yaml. Leaves the result unchanged if that file cannot be read.
void read_training(RunResult& result, const std::filesystem::path& run_folder);

/// Returns whether the folder options.model holds a run with the same training options and seed.
bool holds_same_run(const TrainOptions& options);

/// Returns the result of the run that holds_same_run finds, if that run has finished; empty otherwise.
std::optional<RunResult> finished_run(const TrainOptions& options);

}  // namespace gs
