// SPDX-License-Identifier: Apache-2.0
// Chooses views, and scores Gaussians on them.
#include "eval/runs/shown_views.h"

#include <algorithm>

#include "lib/scene/camera_params.h"
#include "lib/scene/resized.h"

namespace gs {
namespace {

constexpr std::size_t kScoredViews = 64;

}  // namespace

std::vector<View> spread_views(const std::vector<View>& views, std::size_t most) {
    std::vector<View> out;
    const std::size_t count = std::min(most, views.size());
    for (std::size_t k = 0; k < count; ++k) out.push_back(views[k * views.size() / count]);
    return out;
}

std::vector<View> shown_views(const Scene& scene, std::size_t most) {
    return spread_views(scene.test.empty() ? scene.train : scene.test, most);
}

std::vector<float> view_scores(SavedRun& run, const Gaussians& model) {
    const std::vector<View>& views = run.scene.train.empty() ? run.scene.test : run.scene.train;
    if (views.empty()) return {};
    std::vector<RenderRequest> requests;
    for (const View& view : spread_views(views, kScoredViews))
        requests.push_back({.camera = camera_params(without_lens(view.camera)), .background = run.background});
    run.backend->upload(model);
    return run.backend->scores(requests);
}

}  // namespace gs
