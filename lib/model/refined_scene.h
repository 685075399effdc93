// SPDX-License-Identifier: Apache-2.0
// Writes the cameras of a scene as a scene of its own, after they were refined.
#pragma once

#include <filesystem>

#include "lib/scene/scene.h"

namespace gs {

/// Writes all views of `scene`, in its own coordinates, to `folder`: sparse/0 is a COLMAP model in text form whose
/// test.txt names the test views, transforms.json the same for other programs unless it cannot state one of the lenses,
/// and `images` a link to the photographs. Does nothing for a scene without photographs. Throws DataError.
void write_refined_scene(const std::filesystem::path& folder, const Scene& scene);

}  // namespace gs
