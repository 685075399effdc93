// SPDX-License-Identifier: Apache-2.0
// Runs the evaluation loop and writes the side-by-side picture.
#include "eval/runs/evaluate.h"

#include <fmt/format.h>

#include <algorithm>

#include "eval/metrics/colour_fit.h"
#include "eval/metrics/psnr.h"
#include "eval/metrics/quantize.h"
#include "eval/runs/decompose.h"
#include "kernels/core/clock.h"
#include "kernels/core/error.h"
#include "lib/model/run_folder.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

struct Pair {
    Image truth, render;
    double render_seconds = 0;
};

/// Renders views and, in the aligned modes, fits their colours to the photographs.
class Renderer {
  public:
    Renderer(Backend& backend, const Vec3<float>& background, const EvalCorrection& correction,
             const Protocol& protocol)
        : backend_(backend), background_(background), correction_(correction), protocol_(protocol) {
        if (correction_.mode != CorrectionMode::kSceneAligned) return;
        before_ = backend_.download_ppisp();
        if (before_.active()) backend_.upload_ppisp(without_vignetting(before_));
    }
    ~Renderer() {
        if (before_.active()) backend_.upload_ppisp(before_);
    }
    Renderer(const Renderer&) = delete;
    Renderer& operator=(const Renderer&) = delete;

    /// Fits the map that all views share in the mode kSceneAligned.
    void align(const std::vector<View>& views) {
        if (correction_.mode != CorrectionMode::kSceneAligned) return;
        ColourFit fit;
        for (const View& view : views) fit.add(rendered(view), photograph_of(view, background_, protocol_));
        common_ = fit.solve();
    }

    Pair pair(const View& view) {
        const double start = seconds_now();
        RenderedImage image = rendered(view);
        Pair pair;
        pair.render_seconds = seconds_now() - start;
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

  private:
    RenderedImage rendered(const View& view) {
        RenderRequest request;
        request.camera = camera_params(view.camera);
        request.background = background_;
        request.isp = view_isp(view, correction_);
        RenderedImage image;
        backend_.render(request, image);
        return image;
    }

    Backend& backend_;
    const Vec3<float> background_;
    const EvalCorrection correction_;
    const Protocol protocol_;
    PpispState before_;  ///< the backend's own state while it is changed
    std::optional<ColourMap> common_;
};

/// Renders base and residual, writes them where pictures are wanted, and returns the residual's mean.
double decompose(Backend& backend, const View& view, int index, const Vec3<float>& background,
                 const EvalOptions& options) {
    double residual_mean = 0;
    for (const auto& [mode, name] : kPictureParts) {
        if (mode == RenderMode::kFull) continue;
        RenderedImage image;
        backend.render(part_request(camera_params(view.camera), background, mode, view_isp(view, options.correction)),
                       image);
        if (mode == RenderMode::kResidualOnly) residual_mean = mean_value(image);
        if (!options.run_folder.empty())
            write_image(RunFolder{options.run_folder}.picture_part(options.split, options.iteration, name, index),
                        quantized_render(image));
    }
    return residual_mean;
}

/// Returns the means over views. A metric that fails on one view has none, since means over different views do not
/// compare.
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

Image photograph_of(const View& view, const Vec3<float>& background, const Protocol& protocol) {
    const auto loaded = view_image(view);
    Image truth =
        protocol.eight_bit ? quantized_target(loaded->color, background) : float_target(loaded->color, background);
    if (truth.width != view.camera.width || truth.height != view.camera.height)
        throw DataError(fmt::format("{}: the image has {}x{} pixels, its camera {}x{}", view.name, truth.width,
                                    truth.height, view.camera.width, view.camera.height));
    return truth;
}

EvalResult evaluate_views(Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                          const EvalOptions& options) {
    if (views.empty())
        throw UsageError(
            fmt::format("there are no {} views to evaluate; --eval holds some out when training", options.split));
    EvalResult result;
    if (options.decompose) result.residual_mean = 0;
    Renderer renderer(backend, background, options.correction, options.protocol);
    renderer.align(views);
    for (std::size_t i = 0; i < views.size(); ++i) {
        const Pair pair = renderer.pair(views[i]);
        result.views.push_back({views[i].name, psnr(pair.render, pair.truth),
                                ssim(pair.render, pair.truth, options.protocol.ssim_border), pair.render_seconds});
        ViewScore& score = result.views.back();
        for (const Metric& metric : options.metrics)
            score.scores[metric.info.key] = metric.compute(pair.render, pair.truth);
        if (options.decompose) {
            score.residual_mean = decompose(backend, views[i], int(i), background, options);
            *result.residual_mean += *score.residual_mean / double(views.size());
        }
        result.psnr += score.psnr / double(views.size());
        result.ssim += score.ssim / double(views.size());
        result.render_seconds += score.render_seconds;
        if (options.run_folder.empty()) continue;
        const RunFolder folder{options.run_folder};
        write_image(folder.render(options.split, options.iteration, int(i)), pair.render);
        write_image(folder.ground_truth(options.split, options.iteration, int(i)), pair.truth);
    }
    result.scores = mean_scores(result.views);
    return result;
}

void write_comparison(const std::filesystem::path& path, Backend& backend, const std::vector<View>& views,
                      const Vec3<float>& background, int max_views, const EvalCorrection& correction) {
    const int count = std::min<int>(max_views, int(views.size()));
    if (count <= 0) throw UsageError(fmt::format("{}: no views to compare", path.string()));
    std::vector<Pair> pairs;
    Renderer renderer(backend, background, correction, protocols().front());  // a protocol of 8 bits
    renderer.align(views);
    Image sheet{0, 0, 3, {}, {}};
    for (int i = 0; i < count; ++i) {
        pairs.push_back(renderer.pair(views[std::size_t(i) * views.size() / std::size_t(count)]));
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
