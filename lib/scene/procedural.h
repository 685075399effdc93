// SPDX-License-Identifier: Apache-2.0
// Built-in scenes that are rendered by the ray caster when they are loaded.
#pragma once

#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Loads the procedural scene `name` (or the YAML file `name`, when it ends in .yaml): renders all views as 8-bit
/// images and samples initial points from the visible surfaces. Of the options only `resolution` and `eval` apply;
/// without `eval` there are no test views. Training views carry the scene's violations of the static world, test views
/// never do; exposure, white balance and vignetting are those of the camera, which also takes the test views (the scene named
/// by `base:` has the same views without them). Such views know their exposure whether or not EXIF is asked for. Independent of the seed of the training and of the number of threads. Throws as
/// procedural::load_description does.
Scene load_builtin_scene(const std::string& name, const SceneOptions& options);

/// Names for "builtin:NAME", sorted.
std::vector<std::string> builtin_scene_names();

}  // namespace gs
