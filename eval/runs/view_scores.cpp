// SPDX-License-Identifier: Apache-2.0
// Scores Gaussians on views.
#include "eval/runs/view_scores.h"

#include "eval/runs/shown_views.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

constexpr std::size_t kScoredViews = 64;

}  // namespace

std::vector<float> view_scores(SavedRun& run, const Gaussians& model) {
    const std::vector<View>& views = run.scene.train.empty() ? run.scene.test : run.scene.train;
    if (views.empty()) return {};
    std::vector<RenderRequest> requests;
    for (const View& view : spread_views(views, kScoredViews))
        requests.push_back({.camera = camera_params(view.camera), .background = run.background});
    run.backend->upload(model);
    return run.backend->scores(requests);
}

}  // namespace gs
