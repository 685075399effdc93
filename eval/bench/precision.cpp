// SPDX-License-Identifier: Apache-2.0
// Defines the levels, and compares frames of each level with the reference in double.
#include "eval/bench/precision.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "kernels/reference_image.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/scene/camera_params.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"

namespace gs {
namespace {

/// Largest number of views for error measurements; the reference takes seconds per view.
constexpr std::size_t kViews = 4;

struct ReferenceView {
    RenderRequest request;
    std::vector<double> image;
};

std::vector<ReferenceView> reference_views(const std::vector<View>& views, const Vec3<float>& background,
                                           const Gaussians& model) {
    std::vector<ReferenceView> out(std::min(views.size(), kViews));
    for (std::size_t k = 0; k < out.size(); ++k) {
        out[k].request.camera = camera_params(views[k * views.size() / out.size()].camera);
        out[k].request.background = background;
        out[k].image = render_in_double(model, out[k].request);
    }
    return out;
}

void measure_errors(Backend& backend, const std::vector<ReferenceView>& views, PrecisionRow& row) {
    double sum = 0, squares = 0, values = 0;
    RenderedImage image;
    for (const ReferenceView& view : views) {
        backend.render(view.request, image);
        for (std::size_t i = 0; i < view.image.size(); ++i) {
            const double error =
                std::abs(std::clamp(double(image.rgb[i]), 0.0, 1.0) - std::clamp(view.image[i], 0.0, 1.0));
            sum += error, squares += error * error;
            row.largest_error = std::max(row.largest_error, 255 * error);
        }
        values += double(view.image.size());
    }
    row.mean_error = 255 * sum / values;
    row.psnr = squares > 0 ? -10 * std::log10(squares / values) : std::numeric_limits<double>::infinity();
}

}  // namespace

const std::vector<PrecisionLevel>& precision_levels() {
    // The cutoffs are twice (alpha) and ten times (transmittance) those of 3DGS.
    static const std::vector<PrecisionLevel> levels = {
        {"full", false, [](TrainOptions&) {}},
        {"fp32-moments", true, [](TrainOptions& o) { o.appearance_moments = AppearanceMoments::kFp32; }},
        {"half-storage", true, [](TrainOptions& o) { o.appearance_storage = AppearanceStorage::kFp16; }},
        {"cutoffs", false, [](TrainOptions& o) { o.alpha_cutoff = 2, o.transmittance_cutoff = 1e-3; }},
        {"fast", true,
         [](TrainOptions& o) {
             o.appearance_storage = AppearanceStorage::kFp16;
             o.alpha_cutoff = 2, o.transmittance_cutoff = 1e-3;
         }},
    };
    return levels;
}

const PrecisionLevel& precision_level(const std::string& name) {
    std::string names;
    for (const PrecisionLevel& level : precision_levels()) {
        if (level.name == name) return level;
        names += (names.empty() ? "" : ", ") + level.name;
    }
    throw UsageError(fmt::format("precision: '{}' is not one of {}", name, names));
}

std::vector<PrecisionRow> measure_precision(const TrainOptions& options, const Scene& scene, const Gaussians& model,
                                            const BenchOptions& bench) {
    const Vec3<float> background = options.background.color;
    const std::vector<View>& views = scene.test.empty() ? scene.train : scene.test;
    const std::vector<ReferenceView> reference = reference_views(views, background, model);
    std::vector<PrecisionRow> rows;
    for (const PrecisionLevel& level : precision_levels()) {
        if (level.gpu_only && !uses_cuda(options.device)) continue;
        TrainOptions with = options;
        level.apply(with);
        const auto backend = make_backend(options.device, model.appearance, engine_options(with));
        log_device(options.device, *backend);
        backend->upload(model);
        PrecisionRow row{level.name};
        measure_errors(*backend, reference, row);
        row.frame_seconds = frame_seconds(*backend, views, background, bench.frame_repeat);
        row.iteration_seconds = iteration_seconds(*backend, with, scene, model, bench);
        const MemoryUse memory = backend->memory();
        if (!memory.rows.empty() && model.count > 0)
            row.model_bytes = double(memory.rows.front().bytes) / double(model.count);
        rows.push_back(std::move(row));
    }
    return rows;
}

TextTable precision_table(const std::vector<PrecisionRow>& rows) {
    TextTable table;
    table.header = {"precision",  "frame ms",      "iteration ms",       "bytes a Gaussian",
                    "mean error", "largest error", "PSNR against double"};
    table.num_labels = 1;
    for (const PrecisionRow& row : rows)
        table.lines.push_back({{row.name},
                               {fmt::format("{:.3f}", 1e3 * row.frame_seconds)},
                               {fmt::format("{:.3f}", 1e3 * row.iteration_seconds)},
                               {row.model_bytes ? fmt::format("{:.0f}", *row.model_bytes) : "-"},
                               {fmt::format("{:.5f}", row.mean_error)},
                               {fmt::format("{:.2f}", row.largest_error)},
                               {fmt::format("{:.1f}", row.psnr)}});
    return table;
}

std::string precision_json(const std::string& subject, const std::vector<PrecisionRow>& rows) {
    using Json = nlohmann::ordered_json;
    Json json = {{"subject", subject}, {"levels", Json::array()}};
    for (const PrecisionRow& row : rows)
        json["levels"].push_back({{"precision", row.name},
                                  {"frame_seconds", row.frame_seconds},
                                  {"iteration_seconds", row.iteration_seconds},
                                  {"bytes_per_gaussian", row.model_bytes ? Json(*row.model_bytes) : Json()},
                                  {"mean_error", row.mean_error},
                                  {"largest_error", row.largest_error},
                                  {"psnr", std::isfinite(row.psnr) ? Json(row.psnr) : Json()}});
    return json_text(json, 1) + "\n";
}

}  // namespace gs
