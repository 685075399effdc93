// SPDX-License-Identifier: Apache-2.0
// Cameras on a circle, for tests of paths and orbits.
#pragma once

#include <vector>

#include "lib/scene/procedural_description.h"
#include "lib/scene/scene.h"

namespace gs {

/// Cameras 4 units from (1, 2, 0.5), 30 degrees above it.
inline std::vector<View> ring() {
    procedural::CameraRig rig;
    rig.look_at = {1, 2, 0.5};
    rig.elevation_min = rig.elevation_max = 30;
    std::vector<View> views(12);
    rig.train = 12;
    for (int i = 0; i < 12; ++i) views[i].camera = procedural::rig_camera(rig, false, i);
    return views;
}

}  // namespace gs
