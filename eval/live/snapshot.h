// SPDX-License-Identifier: Apache-2.0
// A model as the viewer loads it, made quickly and without measuring what packing loses.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// What a snapshot says beside the model.
struct SnapshotFacts {
    std::string scene;
    std::int64_t iteration = 0;
    Vec3<float> background{0, 0, 0};
    Frame frame;
    std::vector<View> views;  ///< views that the page offers
    bool are_training_views = false;
};

/// Packs the visible Gaussians and writes them as .ngsplat. A photometric correction has neutral exposure and colour in
/// every view. Throws UsageError for a model that cannot be packed, and DataError for parameters that are not finite
/// and where the file cannot be written.
void write_snapshot(const std::filesystem::path& file, const Gaussians& model, const SnapshotFacts& facts);

}  // namespace gs
