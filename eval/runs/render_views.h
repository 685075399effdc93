// SPDX-License-Identifier: Apache-2.0
// Pictures of a finished run from cameras of any origin.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "eval/runs/saved_run.h"

namespace gs {

/// The cameras of pictures that no photograph is compared with, as views without images.
std::vector<View> views_of(const std::vector<Camera>& cameras);

/// The views of a scene in the order of cameras.json: "test", "train", or "all" = test, then train.
std::vector<View> views_of(const Scene& scene, const std::string& which);

/// Writes one picture a view to <folder>/00000.png, ..., before the run's own background; with `decompose` each also as
/// base and residual, to <folder>/{full,base,residual}/00000.png. Throws DataError where a picture cannot be written.
void render_views(SavedRun& run, const std::vector<View>& views, const EvalCorrection& correction, bool decompose,
                  const std::filesystem::path& folder);

}  // namespace gs
