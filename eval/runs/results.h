// SPDX-License-Identifier: Apache-2.0
// results.json and per_view.json of a run folder: the keys of 3DGS's metrics, further facts beside them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "eval/bench/frame_times.h"
#include "eval/runs/evaluate.h"
#include "lib/model/run_folder.h"

namespace gs {

/// What the results should say about the run besides the scores.
struct RunFacts {
    std::string dataset;     ///< the scenes that are averaged with this one
    std::string scene;       ///< as the user named it
    std::string model;       ///< appearance model, e.g. "sh (degree 3)"
    std::string strategy;    ///< densification
    std::string split_rule;  ///< which views were held out
    Vec3<float> background{0, 0, 0};
    std::int64_t num_gaussians = 0;
    std::int64_t bytes_per_gaussian = 0;  ///< of the appearance, as trained
    std::optional<double> train_seconds;  ///< absent: an earlier value in the file is kept
    std::optional<double> controller_seconds;  ///< of training the PPISP controllers, not part of train_seconds; absent: as above
    std::string photometric;  ///< what --ppisp auto decided; empty: as above
    nlohmann::ordered_json appearance_choice;  ///< auto.json of the run, how --appearance auto decided; null: a model that was named
    std::optional<double> frame_seconds;  ///< mean of a frame of the test views, images staying on the device; absent: as above
    std::optional<std::int64_t> peak_device_bytes;  ///< most GPU memory held while training; absent: as above
};

/// Adds iteration `options.iteration` to results.json and per_view.json and keeps what they hold of other iterations:
///   {"ours_N": {"SSIM": .., "PSNR": ..}, "protocol": {"ours_N": {..}}, "timing": {"ours_N": {..}},
///    "memory": {"ours_N": {..}}, "decomposition": {"ours_N": {"residual_mean": ..}}, "num_gaussians": {"ours_N": ..},
///    "photometric": {"ours_N": {"decision": ..}}, "appearance_choice": {"ours_N": {..}}, "run": {"ours_N": {..}}}
///   {"ours_N": {"SSIM": {"00000.png": ..}, "PSNR": {..}}, "decomposition": {"ours_N": {"residual_mean": {"00000.png": ..}}},
///    "image_names": {"ours_N": {"00000.png": ..}}}
/// Further metrics stand beside PSNR and SSIM by MetricInfo::key; of those that gave no number "not_measured":
/// {"ours_N": {"LPIPS-VGG": reason}} says why. "decomposition" is there once a view was decomposed.
/// JSON knows no infinity: a PSNR of identical images is written as null. Atomic per file. Throws DataError when an
/// existing file is no JSON object or cannot be written.
void write_results(const RunFolder& folder, const EvalOptions& options, const EvalResult& result, const RunFacts& facts);

/// Adds "frame_times": {"ours_N": {..}} to results.json, which need not exist. Atomic. Throws as above.
void write_frame_times(const RunFolder& folder, std::int64_t iteration, const FrameTimes& times);

}  // namespace gs
