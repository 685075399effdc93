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
    if (facts.are_training_views) trailer["views"] = "training";
    if (!facts.frame.is_identity()) trailer["frame"] = frame_json(facts.frame);
    scene.trailer = json_text(trailer);
    write_ngsplat(file, scene);
}

}  // namespace gs
