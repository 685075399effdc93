// SPDX-License-Identifier: Apache-2.0
// Packs a model for a page that watches it.
#include "eval/live/snapshot.h"

#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "lib/core/version.h"
#include "lib/export/pack_ppisp.h"
#include "lib/export/pack_scene.h"
#include "lib/scene/frame.h"

namespace gs {

std::vector<View> shown_views(const Scene& scene, std::size_t most) {
    const std::vector<View>& from = scene.test.empty() ? scene.train : scene.test;
    std::vector<View> out;
    const std::size_t count = std::min(most, from.size());
    for (std::size_t k = 0; k < count; ++k) out.push_back(from[k * from.size() / count]);
    return out;
}

void write_snapshot(const std::filesystem::path& file, const Gaussians& model, const SnapshotFacts& facts) {
    require_finite(model);
    const Gaussians visible = visible_gaussians(model);
    PackedScene scene = pack_gaussians(visible);
    add_cameras(scene, visible, facts.views);
    if (model.ppisp.active()) {
        scene.ppisp = pack_ppisp(model.ppisp);
        scene.ppisp->views.resize(facts.views.size());
    }
    nlohmann::ordered_json trailer = {{"generator", version_text()},
                                      {"scene", facts.scene},
                                      {"appearance", model.appearance.model},
                                      {"iteration", facts.iteration},
                                      {"background", {facts.background.x, facts.background.y, facts.background.z}},
                                      {"num_gaussians", scene.count()},
                                      {"bytes_per_gaussian", scene.mean_bytes_per_gaussian()}};
    if (!facts.frame.is_identity()) trailer["frame"] = frame_json(facts.frame);
    scene.trailer = json_text(trailer);
    write_ngsplat(file, scene);
}

}  // namespace gs
