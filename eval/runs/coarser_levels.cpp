// SPDX-License-Identifier: Apache-2.0
// Scores the Gaussians of a run and makes its levels.
#include "eval/runs/coarser_levels.h"

#include <fmt/format.h>

#include "eval/runs/shown_views.h"
#include "kernels/core/error.h"
#include "lib/export/coarser.h"
#include "lib/export/ngsplat.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

/// The most views that scores are measured on.
constexpr std::size_t kScoredViews = 64;

}  // namespace

std::vector<std::int64_t> level_counts(std::int64_t count) {
    std::vector<std::int64_t> counts;
    for (count /= 2; counts.size() < std::size_t(kMostLevels) && count >= ngsplat_unit(); count /= 2)
        counts.push_back(count);
    return counts;
}

std::vector<Gaussians> coarser_levels(SavedRun& run, const Gaussians& model) {
    const std::vector<View>& views = run.scene.train.empty() ? run.scene.test : run.scene.train;
    if (views.empty())
        throw UsageError(
            fmt::format("{}: --lod measures on views what a Gaussian is worth, and there are none; name "
                        "the scene of a point cloud with --source",
                        run.folder.string()));
    const std::vector<std::int64_t> counts = level_counts(model.count);
    if (counts.empty()) return {};
    std::vector<RenderRequest> requests;
    for (const View& view : spread_views(views, kScoredViews))
        requests.push_back({.camera = camera_params(view.camera), .background = run.background});
    run.backend->upload(model);
    const std::vector<float> scores = run.backend->scores(requests);
    std::vector<Gaussians> levels;
    for (const std::int64_t count : counts) levels.push_back(coarser_model(model, scores, count));
    return levels;
}

}  // namespace gs
