// SPDX-License-Identifier: Apache-2.0
// Chooses the correction of a view, and says it in words.
#include "eval/runs/eval_correction.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/model/run_folder.h"

namespace gs {
namespace {

struct Word {
    CorrectionMode mode;
    const char *name, *meaning;
};
constexpr std::array<Word, 5> kWords = {{
    {CorrectionMode::kOff, "off", "none: a model without photometric correction"},
    {CorrectionMode::kController, "controller",
     "exposure and colour of each view predicted by the controller from its own render; vignetting and response of its "
     "camera; no use of the photograph"},
    {CorrectionMode::kNone, "none",
     "neutral exposure and colour; vignetting and response of its camera; no use of the photograph"},
    {CorrectionMode::kColourAligned, "colour-aligned",
     "neutral exposure and colour, then for each view the affine map of colours (3x4, least squares) that fits its "
     "photograph best: uses the test images"},
    {CorrectionMode::kSceneAligned, "scene-aligned",
     "neutral exposure and colour, response of its camera but no vignetting, then for all views together the affine "
     "map of colours (3x4, least squares) that fits the photographs best: uses the test images"},
}};

const Word& word(CorrectionMode mode) {
    return *std::find_if(kWords.begin(), kWords.end(), [&](const Word& w) { return w.mode == mode; });
}

}  // namespace

const char* correction_name(CorrectionMode mode) { return word(mode).name; }

std::string describe_correction(const EvalCorrection& correction) {
    std::string text = word(correction.mode).meaning;
    if (correction.mode == CorrectionMode::kController && correction.exif)
        text += "; the controller is told the EXIF exposure";
    return text;
}

CorrectionMode choose_correction(const std::string& text, CorrectionMode best) {
    if (text.empty()) return best;
    if (text == "none" && best == CorrectionMode::kOff) return best;
    if (text == "controller" && best != CorrectionMode::kController)
        throw UsageError(
            "--ppisp-eval controller: the model has no controller; it was trained without --ppisp, with "
            "--controller-iterations 0, or is not of the last iteration");
    for (const Word& w : kWords)
        if (w.mode != CorrectionMode::kOff && text == w.name) return w.mode;
    throw UsageError(
        fmt::format("--ppisp-eval: '{}' is not one of controller, none, colour-aligned, scene-aligned", text));
}

CorrectionMode best_correction(const PpispState& state) {
    if (!state.active()) return CorrectionMode::kOff;
    return state.controller.empty() ? CorrectionMode::kNone : CorrectionMode::kController;
}

EvalCorrection saved_correction(const std::filesystem::path& run_folder) {
    const auto path = RunFolder{run_folder}.ppisp();
    if (!path_exists(path)) return {};
    const PpispFile file = read_ppisp_json(path);
    return {best_correction(file.state), file.exif, file.mean_exif};
}

PpispState without_vignetting(PpispState state) {
    for (int camera = 0; camera < state.num_cameras; ++camera)
        std::fill_n(state.param.data() + state.camera_offset(camera), 3 * kIspVignetting, 0.0f);
    return state;
}

IspView view_isp(const View& view, const EvalCorrection& correction) {
    IspView isp;
    isp.camera = std::max(0, view.camera_id);
    if (correction.mode == CorrectionMode::kController) {
        isp.mode = IspMode::kController;
        if (correction.exif && view.exif_exposure)
            isp.prior_exposure = float(*view.exif_exposure - correction.mean_exif);
    } else if (correction.mode != CorrectionMode::kOff) {
        isp.mode = IspMode::kFrame;
    }
    return isp;
}

}  // namespace gs
