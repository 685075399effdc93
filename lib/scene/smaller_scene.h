// SPDX-License-Identifier: Apache-2.0
// A scene seen through smaller images.
#pragma once

#include "lib/scene/scene.h"

namespace gs {

/// `scene` with the images of all views at most `width` pixels wide (a box filter), at least 1 pixel high, and intrinsics to match. Views that are
/// not wider stay as they are.
Scene smaller_scene(const Scene& scene, int width);

}  // namespace gs
