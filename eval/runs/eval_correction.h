// SPDX-License-Identifier: Apache-2.0
// The photometric correction of views when they are rendered and scored.
#pragma once

#include <optional>
#include <string>

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
/// Returns the best correction of the model whose ppisp.json is in the run folder; off where there is none.
EvalCorrection saved_correction(const std::filesystem::path& run_folder);

/// Returns the state with vignetting parameters of 0, so that no lens darkens anything.
PpispState without_vignetting(PpispState state);

/// Returns the correction that the renderer is asked for. A camera that the training did not know counts as camera 0,
/// and missing EXIF as mean exposure.
IspView view_isp(const View& view, const EvalCorrection& correction);

}  // namespace gs
