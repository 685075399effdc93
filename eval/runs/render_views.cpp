// SPDX-License-Identifier: Apache-2.0
// Renders views of an open run into files.
#include "eval/runs/render_views.h"

#include <fmt/format.h>

#include "eval/metrics/quantize.h"
#include "eval/runs/decompose.h"
#include "lib/scene/camera_params.h"

namespace gs {

std::vector<View> views_of(const std::vector<Camera>& cameras) {
    std::vector<View> views(cameras.size());
    for (std::size_t i = 0; i < cameras.size(); ++i) views[i].camera = cameras[i];
    return views;
}

std::vector<View> views_of(const Scene& scene, const std::string& which) {
    std::vector<View> views;
    if (which != "train") views = scene.test;
    if (which != "test") views.insert(views.end(), scene.train.begin(), scene.train.end());
    return views;
}

void render_views(SavedRun& run, const std::vector<View>& views, const EvalCorrection& correction, bool decompose,
                  const std::filesystem::path& folder) {
    RenderedImage image;
    for (std::size_t i = 0; i < views.size(); ++i) {
        const std::string file = fmt::format("{:05}.png", i);
        for (const auto& [mode, name] : kPictureParts) {
            if (!decompose && mode != RenderMode::kFull) continue;
            run.backend->render(
                part_request(camera_params(views[i].camera), run.background, mode, view_isp(views[i], correction)),
                image);
            write_image(decompose ? folder / name / file : folder / file, quantized_render(image));
        }
    }
}

}  // namespace gs
