// SPDX-License-Identifier: Apache-2.0
// Loads built-in scenes, whose images the ray caster renders on loading.
#pragma once

#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Loads the procedural scene `name` (or the YAML file `name`, if it ends in .yaml). Renders all views as 8-bit images
/// and samples initial points from the visible surfaces. Only the options `resolution` and `eval` apply; without `eval`
/// there are no test views. Moved shapes and shadows appear only in training views. Exposure, white balance and
/// vignetting belong to the camera, so they also affect the test views (the scene named by `base:` has the same views
/// without them). Such views have their exposure set even if EXIF is not requested. The result does not depend on the
/// training seed or the number of threads. Throws as procedural::load_description does.
Scene load_builtin_scene(const std::string& name, const SceneOptions& options);

/// Returns the names for "builtin:NAME", sorted.
std::vector<std::string> builtin_scene_names();

}  // namespace gs
