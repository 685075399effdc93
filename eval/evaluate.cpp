// SPDX-License-Identifier: Apache-2.0
// The evaluation loop and the side-by-side picture.
#include "eval/evaluate.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <chrono>

#include "eval/decompose.h"
#include "eval/psnr.h"
#include "eval/quantize.h"
#include "kernels/core/error.h"
#include "lib/model/run_folder.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

struct Pair {
    Image truth, render;
    double render_seconds = 0;
};

Pair render_pair(Backend& backend, const View& view, const Vec3<float>& background) {
    RenderRequest request;
    request.camera = camera_params(view.camera);
    request.background = background;
    RenderedImage rendered;
    const auto start = std::chrono::steady_clock::now();
    backend.render(request, rendered);
    Pair pair;
    pair.render_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    pair.render = quantized_render(rendered);
    pair.truth = quantized_target(view.load().color, background);
    if (pair.truth.width != pair.render.width || pair.truth.height != pair.render.height)
        throw DataError(fmt::format("{}: the image has {}x{} pixels, its camera {}x{}", view.name, pair.truth.width, pair.truth.height,
                                    pair.render.width, pair.render.height));
    return pair;
}

/// Renders the parts beside the full picture, writes them where pictures are wanted, and returns the residual's mean.
double decompose(Backend& backend, const View& view, int index, const Vec3<float>& background, const EvalOptions& options) {
    double residual_mean = 0;
    for (const auto& [mode, name] : kPictureParts) {
        if (mode == RenderMode::kFull) continue;
        RenderedImage image;
        backend.render(part_request(camera_params(view.camera), background, mode), image);
        if (mode == RenderMode::kResidualOnly) residual_mean = mean_value(image);
        if (!options.run_folder.empty())
            write_image(RunFolder{options.run_folder}.picture_part(options.split, options.iteration, name, index), quantized_render(image));
    }
    return residual_mean;
}

void paste(const Image& from, Image& to, int left, int top) {
    for (int y = 0; y < from.height; ++y) {
        std::copy_n(&from.u8[std::size_t(y) * from.width * 3], std::size_t(from.width) * 3,
                    &to.u8[(std::size_t(top + y) * to.width + left) * 3]);
    }
}

}  // namespace

EvalResult evaluate_views(Backend& backend, const std::vector<View>& views, const Vec3<float>& background, const EvalOptions& options) {
    if (views.empty())
        throw UsageError(fmt::format("there are no {} views to evaluate; --eval holds some out when training", options.split));
    EvalResult result;
    if (options.decompose) result.residual_mean = 0;
    for (std::size_t i = 0; i < views.size(); ++i) {
        const Pair pair = render_pair(backend, views[i], background);
        result.views.push_back(
            {views[i].name, psnr(pair.render, pair.truth), ssim(pair.render, pair.truth, options.ssim_border), pair.render_seconds});
        ViewScore& score = result.views.back();
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
    return result;
}

void write_comparison(const std::filesystem::path& path, Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                      int max_views) {
    const int count = std::min<int>(max_views, int(views.size()));
    if (count <= 0) throw UsageError(fmt::format("{}: no views to compare", path.string()));
    std::vector<Pair> pairs;
    Image sheet{0, 0, 3, {}, {}};
    for (int i = 0; i < count; ++i) {
        pairs.push_back(render_pair(backend, views[std::size_t(i) * views.size() / std::size_t(count)], background));
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
