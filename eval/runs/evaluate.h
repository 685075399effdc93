// SPDX-License-Identifier: Apache-2.0
// Renders views, compares them with the photographs, keeps the pictures.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "eval/metrics/metrics.h"
#include "eval/runs/eval_correction.h"
#include "eval/runs/protocol.h"
#include "kernels/backend.h"
#include "lib/scene/scene.h"

namespace gs {

struct EvalOptions {
    Protocol protocol = protocols().front();
    std::filesystem::path run_folder;  ///< pictures go to <run>/<split>/ours_<iteration>/{renders,gt}; empty = none are written
    std::int64_t iteration = 0;
    std::string split = "test";
    EvalCorrection correction;
    bool decompose = false;  ///< also render base and residual of each view; pictures go beside renders, to {base,residual}
    std::vector<Metric> metrics = {};  ///< beside PSNR and SSIM, which are always computed
};

struct ViewScore {
    std::string name;  ///< of the photograph
    double psnr = 0;   ///< dB; infinity for identical images
    double ssim = 0;
    double render_seconds = 0;
    std::optional<double> residual_mean = {};  ///< mean_value of the residual picture, when decomposed
    std::map<std::string, MetricScore> scores = {};  ///< of options.metrics, by MetricInfo::key
};

struct EvalResult {
    std::vector<ViewScore> views;
    double psnr = 0, ssim = 0;  ///< means over views
    double render_seconds = 0;  ///< sum over views, without loading, metrics, writing and decomposition
    std::optional<double> residual_mean = {};  ///< mean over views, when decomposed
    std::map<std::string, MetricScore> scores = {};  ///< means over views; the reason of the first view where any has one
};

/// Renders each view at the size of its camera and compares it with its photograph as the protocol says: both rounded to 8 bits, or as
/// float. The scene is loaded and rendered before the run's own background in any case; masks are ignored. Pictures are 8-bit. Of the parts of a decomposed picture the base is corrected like the picture
/// (with a controller: by what it makes of the base), the residual never. Throws UsageError without views, DataError when an image cannot be
/// read, has another size than its camera, or a picture cannot be written.
EvalResult evaluate_views(Backend& backend, const std::vector<View>& views, const Vec3<float>& background, const EvalOptions& options);

/// Writes up to `max_views` of the views, evenly spread, below one another: photograph left, corrected render right.
void write_comparison(const std::filesystem::path& path, Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                      int max_views, const EvalCorrection& correction = {});

}  // namespace gs
