// SPDX-License-Identifier: Apache-2.0
// Chooses and describes the correction of a view, runs the evaluation loop and writes the side-by-side image.
#include "eval/runs/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "eval/metrics/pixel_metrics.h"
#include "eval/metrics/quantize.h"
#include "eval/runs/decompose.h"
#include "eval/runs/render_queue.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/version.h"
#include "lib/model/run_folder.h"
#include "lib/scene/camera_params.h"

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

struct Pair {
    Image truth, render;
    double render_seconds = 0;
};

/// Makes the pixels of a render black that the view's lens does not see, as they are in the photograph.
RenderedImage seen_part(const View& view, RenderedImage image) {
    if (!view.lens_weights) return image;
    const std::size_t pixels = view.lens_weights->u8.size();
    for (std::size_t i = 0; i < pixels; ++i)
        if (!view.lens_weights->u8[i]) image.rgb[i] = image.rgb[pixels + i] = image.rgb[2 * pixels + i] = 0;
    return image;
}

/// Renders views, each with its parts if requested, and in the aligned modes fits their colours to the photographs.
class Renderer {
  public:
    Renderer(Backend& backend, const Vec3<float>& background, const EvalCorrection& correction,
             const Protocol& protocol, bool with_parts = false)
        : backend_(backend),
          background_(background),
          correction_(correction),
          protocol_(protocol),
          with_parts_(with_parts) {
        if (correction_.mode != CorrectionMode::kSceneAligned) return;
        before_ = backend_.download_ppisp();
        if (before_.active()) backend_.upload_ppisp(without_vignetting(before_));
    }
    ~Renderer() {
        if (before_.active()) backend_.upload_ppisp(before_);
    }
    Renderer(const Renderer&) = delete;
    Renderer& operator=(const Renderer&) = delete;

    /// Fits the colour map that all views share in mode kSceneAligned.
    void align(const std::vector<View>& views) {
        if (correction_.mode != CorrectionMode::kSceneAligned) return;
        RenderQueue renders(backend_, requests(views, false));
        ColourFit fit;
        for (const View& view : views)
            fit.add(seen_part(view, renders.next()), photograph_of(view, background_, protocol_));
        common_ = fit.solve();
    }
    /// Sets the views for the following calls of pair(), in their order.
    void begin(const std::vector<View>& views) { renders_.emplace(backend_, requests(views, with_parts_)); }

    Pair pair(const View& view) {
        RenderedImage image = seen_part(view, renders_->next());
        Pair pair;
        pair.render_seconds = renders_->seconds();
        pair.truth = photograph_of(view, background_, protocol_);
        if (correction_.mode == CorrectionMode::kColourAligned) {
            ColourFit fit;
            fit.add(image, pair.truth);
            apply_colours(fit.solve(), image);
        } else if (common_) {
            apply_colours(*common_, image);
        }
        pair.render = protocol_.eight_bit ? quantized_render(image) : float_render(image);
        return pair;
    }

    /// Returns the next part, base or residual, of the view last passed to pair().
    RenderedImage part() { return renders_->next(); }

  private:
    std::vector<RenderRequest> requests(const std::vector<View>& views, bool with_parts) const {
        std::vector<RenderRequest> all;
        for (const View& view : views)
            for (const auto& [mode, name] : kPictureParts)
                if (mode == RenderMode::kFull || with_parts)
                    all.push_back(
                        part_request(camera_params(view.camera), background_, mode, view_isp(view, correction_)));
        return all;
    }

    Backend& backend_;
    const Vec3<float> background_;
    const EvalCorrection correction_;
    const Protocol protocol_;
    const bool with_parts_;
    std::optional<RenderQueue> renders_;
    PpispState before_;  ///< the backend's own state during the change
    std::optional<ColourMap> common_;
};

/// Renders base and residual of a view, writes them if images are saved, and returns the residual's mean.
double decompose(Renderer& renderer, int index, const EvalOptions& options) {
    double residual_mean = 0;
    for (const auto& [mode, name] : kPictureParts) {
        if (mode == RenderMode::kFull) continue;
        const RenderedImage image = renderer.part();
        if (mode == RenderMode::kResidualOnly) residual_mean = mean_value(image);
        if (!options.run_folder.empty())
            write_image(RunFolder{options.run_folder}.picture_part(options.split, options.iteration, name, index),
                        quantized_render(image));
    }
    return residual_mean;
}

/// Returns the means over views. A metric that failed on one view has no mean, because means over different views are
/// not comparable.
std::map<std::string, MetricScore> mean_scores(const std::vector<ViewScore>& views) {
    std::map<std::string, MetricScore> means;
    for (const ViewScore& view : views) {
        for (const auto& [key, score] : view.scores) {
            MetricScore& mean = means.try_emplace(key, MetricScore{0.0, ""}).first->second;
            if (!mean.value) continue;
            if (score.value)
                *mean.value += *score.value / double(views.size());
            else
                mean = score;
        }
    }
    return means;
}

void paste(const Image& from, Image& to, int left, int top) {
    for (int y = 0; y < from.height; ++y) {
        std::copy_n(&from.u8[std::size_t(y) * from.width * 3], std::size_t(from.width) * 3,
                    &to.u8[(std::size_t(top + y) * to.width + left) * 3]);
    }
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

Image photograph_of(const View& view, const Vec3<float>& background, const Protocol& protocol) {
    const auto loaded = view_image(view);
    return protocol.eight_bit ? quantized_target(loaded->color, background) : float_target(loaded->color, background);
}

nlohmann::ordered_json protocol_json(const EvalOptions& options, const Vec3<float>& background, std::size_t num_views) {
    const bool aligned = options.correction.mode == CorrectionMode::kColourAligned ||
                         options.correction.mode == CorrectionMode::kSceneAligned;
    const Protocol& protocol = options.protocol;
    const std::string rounding = protocol.eight_bit ? "8 bits: " : "float: ",
                      steps = protocol.eight_bit ? ", *255, +0.5, truncated" : "";
    nlohmann::ordered_json json = {
        {"name", protocol.name},
        {"line", protocol_line(protocol, background)},
        {"images", rounding + (aligned ? "aligned to the photographs, " : "") + "clamped to [0,1]" + steps +
                       "; no crop, no mask" + (aligned ? "" : ", no colour alignment")},
        {"image_source", protocol.images},
        {"ppisp_eval", correction_name(options.correction.mode)},
        {"photometric", describe_correction(options.correction)},
        {"psnr", "10 log10(1/MSE) over all pixels and channels, mean over images; null = identical images"},
        {"ssim", describe_ssim(protocol.ssim_border) + ", mean over images"},
        {"lpips", fmt::format("{}, inputs in {}", lpips_metric(protocol.lpips_net),
                              protocol.lpips_range == LpipsRange::kSymmetric ? "[-1,1]" : "[0,1]")},
        {"background", {background.x, background.y, background.z}},
        {"split", options.split_rule},
        {"num_views", num_views},
        {"program", version_text()},
    };
    if (options.align_cameras)
        json["aligned_cameras"] =
            "the same with the pose of each test view fitted to the finished model by the loss of the training: uses "
            "the test images, does not compare with PSNR and SSIM";
    for (const Metric& metric : options.metrics) json[metric.info.name] = metric.protocol + ", mean over images";
    return json;
}

RunResult evaluate_views(Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                         const EvalOptions& options) {
    if (views.empty())
        throw UsageError(
            fmt::format("there are no {} views to evaluate; --eval holds some out when training", options.split));
    RunResult result;
    result.iteration = options.iteration;
    result.protocol = protocol_json(options, background, views.size());
    double render_seconds = 0;
    if (options.decompose) result.residual_mean = 0;
    Renderer renderer(backend, background, options.correction, options.protocol, options.decompose);
    renderer.align(views);
    renderer.begin(views);
    for (std::size_t i = 0; i < views.size(); ++i) {
        const Pair pair = renderer.pair(views[i]);
        result.views.push_back({views[i].name, psnr(pair.render, pair.truth),
                                ssim(pair.render, pair.truth, options.protocol.ssim_border), pair.render_seconds});
        ViewScore& score = result.views.back();
        for (const Metric& metric : options.metrics)
            score.scores[metric.info.key] = metric.compute(pair.render, pair.truth);
        if (options.decompose) {
            score.residual_mean = decompose(renderer, int(i), options);
            *result.residual_mean += *score.residual_mean / double(views.size());
        }
        result.psnr += score.psnr / double(views.size());
        result.ssim += score.ssim / double(views.size());
        render_seconds += score.render_seconds;
        if (options.run_folder.empty()) continue;
        const RunFolder folder{options.run_folder};
        write_image(folder.render(options.split, options.iteration, int(i)), pair.render);
        write_image(folder.ground_truth(options.split, options.iteration, int(i)), pair.truth);
    }
    result.render_seconds = render_seconds;
    result.scores = mean_scores(result.views);
    return result;
}

void write_comparison(const std::filesystem::path& path, Backend& backend, const std::vector<View>& views,
                      const Vec3<float>& background, int max_views, const EvalCorrection& correction) {
    const int count = std::min<int>(max_views, int(views.size()));
    if (count <= 0) throw UsageError(fmt::format("{}: no views to compare", path.string()));
    std::vector<Pair> pairs;
    Renderer renderer(backend, background, correction, protocols().front());  // an 8-bit protocol
    renderer.align(views);
    std::vector<View> some;
    for (int i = 0; i < count; ++i) some.push_back(views[std::size_t(i) * views.size() / std::size_t(count)]);
    renderer.begin(some);
    Image sheet{0, 0, 3, {}, {}};
    for (const View& view : some) {
        pairs.push_back(renderer.pair(view));
        sheet.width = std::max(sheet.width, 2 * pairs.back().truth.width);
        sheet.height += pairs.back().truth.height;
    }
    sheet.u8.assign(std::size_t(sheet.width) * sheet.height * 3, 0);
    int top = 0;
    for (const Pair& pair : pairs) {
        paste(pair.truth, sheet, 0, top);
        paste(pair.render, sheet, pair.truth.width, top);
        top += pair.truth.height;
    }
    write_image(path, sheet);
}

}  // namespace gs
