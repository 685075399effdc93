// SPDX-License-Identifier: Apache-2.0
// Renders images of a finished run from arbitrary cameras.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "eval/runs/saved_run.h"

namespace gs {

/// Returns cameras of images without photographs as views without images.
std::vector<View> views_of(const std::vector<Camera>& cameras);

/// Returns the held-out views ("test") or the training views ("train") of a scene.
const std::vector<View>& views_of(const Scene& scene, const std::string& which);

/// Additional outputs of rendering.
struct RenderParts {
    bool decompose = false;  ///< writes the images to full/, and base and residual to base/ and residual/
    /// For each quantity: writes an OpenEXR file with its values (GeometryRenderer), and an image of them, to depth/,
    /// median_depth/, normals/ and alpha/. Alpha is one minus the transmittance.
    bool depth = false, median_depth = false, normals = false, alpha = false;
};

/// Returns the folder of the images within the output folder.
std::filesystem::path picture_folder(const std::filesystem::path& folder, const RenderParts& parts);

/// Returns the names of the files that render_views() writes, relative to its folder.
std::vector<std::string> render_files(const RenderParts& parts, std::size_t num_views);

/// Writes one image per view to <folder>/00000.png, ..., over the run's own background, and the parts. Throws DataError
/// if a file cannot be written, and Interrupted.
void render_views(SavedRun& run, const std::vector<View>& views, const EvalCorrection& correction,
                  const RenderParts& parts, const std::filesystem::path& folder);

}  // namespace gs
