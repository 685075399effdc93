// SPDX-License-Identifier: Apache-2.0
// How views are corrected photometrically when they are rendered and scored.
#pragma once

#include <optional>
#include <string>

#include "kernels/backend.h"
#include "lib/model/ppisp_json.h"
#include "lib/scene/scene.h"

namespace gs {

enum class CorrectionMode {
    kOff,            ///< a model without PPISP
    kController,     ///< exposure and colour predicted from the view's own render (and EXIF, where the model was told)
    kNone,           ///< neutral exposure and colour; vignetting and response of the camera
    kColourAligned,  ///< as kNone, then the affine colour transform that fits the photograph best; uses the test image
    kSceneAligned,   ///< as kNone without the vignetting, then one affine colour transform for all views; uses the test images
};

struct EvalCorrection {
    CorrectionMode mode = CorrectionMode::kOff;
    bool exif = false;     ///< the controller expects EXIF exposures
    double mean_exif = 0;  ///< what they are relative to
};

/// "off", "controller", "none", "colour-aligned", "scene-aligned".
const char* correction_name(CorrectionMode mode);
/// One sentence for results.json.
std::string describe_correction(const EvalCorrection& correction);

/// The mode of `--ppisp-eval`; empty text = `best` of the model. Throws UsageError for other words, and for a controller that the model does
/// not have.
CorrectionMode choose_correction(const std::string& text, CorrectionMode best);

/// The best a model can do: its controller, else neutral values, or nothing without PPISP.
CorrectionMode best_correction(const PpispState& state);
/// That of the model whose ppisp.json is in the run folder; off where there is none.
EvalCorrection saved_correction(const std::filesystem::path& run_folder);

/// The same with lenses that do not darken anything.
PpispState without_vignetting(PpispState state);

/// What the renderer is asked for. A camera that the training did not know is taken as camera 0, EXIF that is missing as of mean exposure.
IspView view_isp(const View& view, const EvalCorrection& correction);

}  // namespace gs
