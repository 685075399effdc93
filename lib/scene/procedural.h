// SPDX-License-Identifier: Apache-2.0
// Built-in scenes, which the ray caster renders when they are loaded.
#pragma once

#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Loads the procedural scene `name` (or the YAML file `name`, when it ends in .yaml). Renders all views as 8-bit
/// images and samples initial points from the visible surfaces. Only the options `resolution` and `eval` apply; without
/// `eval` there are no test views. Only training views show moved shapes and shadows. Exposure, white balance and
/// vignetting belong to the camera, which also takes the test views (the scene named by `base:` has the same views
/// without them); such views know their exposure even when EXIF is not asked for. The result does not depend on the
/// training's seed or the number of threads. Throws as procedural::load_description does.
Scene load_builtin_scene(const std::string& name, const SceneOptions& options);

/// Returns the names for "builtin:NAME", sorted.
std::vector<std::string> builtin_scene_names();

}  // namespace gs
