// SPDX-License-Identifier: Apache-2.0
// Renders views with their photometric corrections, compares them with their photographs and saves the images.
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

/// Photometric corrections of a view.
enum class CorrectionMode {
    kOff,  ///< no correction: a model without PPISP
    /// Exposure and colour predicted from the view's own render (and from EXIF, if the model was trained with it)
    kController,
    kNone,           ///< neutral exposure and colour; vignetting and response of the camera
    kColourAligned,  ///< kNone, then the affine colour map that fits the photograph best; uses the test image
    kSceneAligned,   ///< kNone without vignetting, then one affine colour map for all views; uses the test images
};

/// A correction mode and the inputs of its controller.
struct EvalCorrection {
    CorrectionMode mode = CorrectionMode::kOff;
    bool exif = false;     ///< whether the controller expects EXIF exposures
    double mean_exif = 0;  ///< mean EXIF exposure; the controller's inputs are relative to it
};

/// Returns "off", "controller", "none", "colour-aligned" or "scene-aligned".
const char* correction_name(CorrectionMode mode);
/// Returns the description of the correction for results.json, one sentence.
std::string describe_correction(const EvalCorrection& correction);

/// Returns the mode named by `--ppisp-eval`, or the model's `best` mode if the text is empty. Throws UsageError for
/// other words, and for "controller" if the model has none.
CorrectionMode choose_correction(const std::string& text, CorrectionMode best);

/// Returns the best mode of a model: its controller, else neutral values; kOff without PPISP.
CorrectionMode best_correction(const PpispState& state);
/// Returns the best correction of the model whose ppisp.json is in the run folder; off if there is none.
EvalCorrection saved_correction(const std::filesystem::path& run_folder);

/// Returns the state with all vignetting parameters set to 0, so that no lens darkens the image.
PpispState without_vignetting(PpispState state);

/// Returns the correction to request from the renderer. A camera that was not part of the training counts as camera 0,
/// and missing EXIF as the mean exposure.
IspView view_isp(const View& view, const EvalCorrection& correction);

/// Settings of an evaluation: protocol, metrics and images.
struct EvalOptions {
    Protocol protocol = protocols().front();
    std::filesystem::path run_folder;  ///< folder for images <split>/ours_<iteration>/{renders,gt}; empty = none
    std::int64_t iteration = 0;
    std::string split = "test";
    std::string split_rule = {};  ///< rule that chose the views, for the protocol line
    EvalCorrection correction;
    bool align_cameras = false;        ///< also scores the views with cameras aligned to the model
    bool decompose = false;            ///< also renders the base and residual of each view, to folders of these names
    std::vector<Metric> metrics = {};  ///< metrics in addition to PSNR and SSIM, which are always computed
};

/// Returns the photograph of a view as the protocol compares it, composited over `background` if it has alpha. Throws
/// DataError if it cannot be read, or if its size differs from its camera's.
Image photograph_of(const View& view, const Vec3<float>& background, const Protocol& protocol = protocols().front());

/// Returns `protocol` of results.json: a description of how the scores of `num_views` views are computed.
nlohmann::ordered_json protocol_json(const EvalOptions& options, const Vec3<float>& background, std::size_t num_views);

/// Renders each view at its camera's size over `background` (not the protocol's background), and compares it with its
/// photograph as the protocol prescribes, both rounded to 8 bits or both as float. Masks are ignored. Saved images are
/// 8-bit. The base of a decomposed image is corrected like the full image (a controller predicts from the base itself),
/// the residual never. Returns the iteration, the scores, their protocol and the rendering time; a metric that failed
/// on a view has the first failure's reason instead of a mean. Throws UsageError without views, and DataError if an
/// image cannot be read, differs in size from its camera, or cannot be written.
RunResult evaluate_views(Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                         const EvalOptions& options);

/// Writes one image of up to `max_views` views, evenly spaced and stacked vertically: the photograph on the left, the
/// corrected render on the right. Throws UsageError without views, and otherwise the errors of evaluate_views.
void write_comparison(const std::filesystem::path& path, Backend& backend, const std::vector<View>& views,
                      const Vec3<float>& background, int max_views, const EvalCorrection& correction = {});

}  // namespace gs
