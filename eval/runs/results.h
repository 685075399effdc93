// SPDX-License-Identifier: Apache-2.0
// Writes results.json and per_view.json of a run folder: the keys of 3DGS's metrics.py and further facts.
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

/// The facts about a run that its results state beside the scores.
struct RunFacts {
    std::string dataset;     ///< name of the dataset; its scenes are averaged
    std::string scene;       ///< name of the scene
    std::string model;       ///< appearance model, e.g. "sh (degree 3)"
    std::string strategy;    ///< strategy of densification
    std::string split_rule;  ///< rule that chose the held-out views
    Frame frame;             ///< frame that the model was trained in
    Vec3<float> background{0, 0, 0};
    std::int64_t num_gaussians = 0;
    double residual_share = 1;                ///< share of the Gaussians that have a residual, where the model has one
    std::int64_t bytes_per_gaussian = 0;      ///< mean size of base and residual, as trained
    std::int64_t ply_bytes_per_gaussian = 0;  ///< size of a whole Gaussian in point_cloud.ply
    /// Mean size of a whole Gaussian in scene.ngsplat; empty for a model that cannot be packed
    std::optional<std::int64_t> web_bytes_per_gaussian;
    std::optional<double> train_seconds;  ///< absent: the file keeps an earlier value
    std::optional<double>
        controller_seconds;   ///< time of the controllers' training, not in train_seconds; absent: as above
    std::string photometric;  ///< decision of --ppisp auto; empty: as above
    nlohmann::ordered_json appearance_choice;       ///< the run's auto.json; null where the model was named
    nlohmann::ordered_json plan;                    ///< plan of a run with constraints; null without
    std::optional<double> frame_seconds;            ///< mean of a frame without the copy to the host; absent: as above
    std::optional<std::int64_t> peak_device_bytes;  ///< most GPU memory held while training; absent: as above
};

/// Adds iteration `options.iteration` to results.json and per_view.json and keeps their other iterations:
///   {"ours_N": {"SSIM": .., "PSNR": ..}, "protocol": {"ours_N": {..}}, "timing": {"ours_N": {..}},
///    "memory": {"ours_N": {..}}, "decomposition": {"ours_N": {"residual_mean": ..}}, "num_gaussians": {"ours_N": ..},
///    "photometric": {"ours_N": {"decision": ..}}, "appearance_choice": {"ours_N": {..}}, "plan": {"ours_N": {..}},
///    "run": {"ours_N": {..}}}
///   {"ours_N": {"SSIM": {"00000.png": ..}, "PSNR": {..}},
///    "decomposition": {"ours_N": {"residual_mean": {"00000.png": ..}}}, "image_names": {"ours_N": {"00000.png": ..}}}
/// Further metrics stand beside PSNR and SSIM by MetricInfo::key. "not_measured": {"ours_N": {"LPIPS-VGG": reason}}
/// says why a metric gave no number. "decomposition" is there when views were decomposed. The infinite PSNR of
/// identical images is written as null, because JSON knows no infinity. Each file is replaced atomically. Throws
/// DataError when an existing file is no JSON object or cannot be written.
void write_results(const RunFolder& folder, const EvalOptions& options, const EvalResult& result,
                   const RunFacts& facts);

/// Adds "frame_times": {"ours_N": {..}} to results.json, which need not exist. Atomic; throws as write_results does.
void write_frame_times(const RunFolder& folder, std::int64_t iteration, const FrameTimes& times);

}  // namespace gs
