// SPDX-License-Identifier: Apache-2.0
// Renders views, with the photometric correction that each gets, compares them with their photographs and keeps the
// pictures.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "eval/metrics/metrics.h"
#include "eval/runs/protocol.h"
#include "eval/runs/run_result.h"
#include "kernels/ranks/backend.h"
#include "lib/model/ppisp_json.h"
#include "lib/scene/scene.h"

namespace gs {

/// The ways to correct a view.
enum class CorrectionMode {
    kOff,            ///< no correction: a model without PPISP
    kController,     ///< exposure and colour predicted from the view's own render (and EXIF, where the model was told)
    kNone,           ///< neutral exposure and colour; vignetting and response of the camera
    kColourAligned,  ///< as kNone, then the affine map of colours that fits the photograph best; uses the test image
    kSceneAligned,   ///< as kNone without vignetting, then one affine map of colours for all views; uses test images
};

/// A mode and what its controller needs.
struct EvalCorrection {
    CorrectionMode mode = CorrectionMode::kOff;
    bool exif = false;     ///< the controller expects EXIF exposures
    double mean_exif = 0;  ///< mean exposure that they are relative to
};

/// Returns "off", "controller", "none", "colour-aligned" or "scene-aligned".
const char* correction_name(CorrectionMode mode);
/// Returns one sentence for results.json.
std::string describe_correction(const EvalCorrection& correction);

/// Returns the mode of `--ppisp-eval`, or the model's `best` for an empty text. Throws UsageError for other words, and
/// for a controller that the model does not have.
CorrectionMode choose_correction(const std::string& text, CorrectionMode best);

/// Returns the best mode of a model: its controller, else neutral values, or kOff without PPISP.
CorrectionMode best_correction(const PpispState& state);
/// Returns the best correction of the model whose ppisp.json is in the run folder; off if there is none.
EvalCorrection saved_correction(const std::filesystem::path& run_folder);

/// Returns the state with vignetting parameters of 0, so that no lens darkens anything.
PpispState without_vignetting(PpispState state);

/// Returns the correction that the renderer is asked for. A camera that the training did not know counts as camera 0,
/// and missing EXIF as mean exposure.
IspView view_isp(const View& view, const EvalCorrection& correction);

/// The choices of an evaluation: protocol, metrics and pictures.
struct EvalOptions {
    Protocol protocol = protocols().front();
    std::filesystem::path run_folder;  ///< pictures go to its <split>/ours_<iteration>/{renders,gt}; empty = none
    std::int64_t iteration = 0;
    std::string split = "test";
    std::string split_rule = {};  ///< rule that chose the views, for the protocol
    EvalCorrection correction;
    bool decompose = false;            ///< also renders base and residual of each view, to folders of these names
    std::vector<Metric> metrics = {};  ///< metrics beside PSNR and SSIM, which are always computed
};

/// Returns the photograph of a view as the protocol compares it, on `background` where it has alpha. Throws DataError
/// if it cannot be read, or has another size than its camera.
Image photograph_of(const View& view, const Vec3<float>& background, const Protocol& protocol = protocols().front());

/// Returns how the scores of `num_views` views are made, as `protocol` of results.json has it.
nlohmann::ordered_json protocol_json(const EvalOptions& options, const Vec3<float>& background, std::size_t num_views);

/// Renders each view at the size of its camera before `background`, whatever the protocol names, and compares it with
/// its photograph as the protocol says, both rounded to 8 bits or as float. Masks are ignored. Pictures are 8-bit. The
/// base of a decomposed picture is corrected like the picture (a controller predicts from the base itself), the
/// residual never. Returns the iteration, the scores, their protocol and the time of rendering; a metric that failed on
/// a view has the first reason instead of a mean. Throws UsageError without views, and DataError when an image cannot
/// be read, has another size than its camera, or a picture cannot be written.
RunResult evaluate_views(Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                         const EvalOptions& options);

/// Writes one image of up to `max_views` views, evenly spread and below one another: the photograph on the left, the
/// corrected render on the right. Throws UsageError without views, and otherwise what evaluate_views throws.
void write_comparison(const std::filesystem::path& path, Backend& backend, const std::vector<View>& views,
                      const Vec3<float>& background, int max_views, const EvalCorrection& correction = {});

}  // namespace gs
