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

/// The views of a scene that were held out ("test") or not ("train").
const std::vector<View>& views_of(const Scene& scene, const std::string& which);

/// What is written beside the pictures.
struct RenderParts {
    bool decompose = false;  ///< pictures in full/, and the same as base/ and residual/
    /// An OpenEXR file with the values (GeometryRenderer), and a picture of them, in depth/, median_depth/, normals/
    /// and alpha/. Alpha is one minus the transmittance.
    bool depth = false, median_depth = false, normals = false, alpha = false;
};

/// Returns where the pictures lie in the output folder.
std::filesystem::path picture_folder(const std::filesystem::path& folder, const RenderParts& parts);

/// Returns the names of the files that render_views() writes, relative to its folder.
std::vector<std::string> render_files(const RenderParts& parts, std::size_t num_views);

/// Writes one picture a view to <folder>/00000.png, ..., before the run's own background, and the parts. Throws
/// DataError if a file cannot be written, and Interrupted.
void render_views(SavedRun& run, const std::vector<View>& views, const EvalCorrection& correction,
                  const RenderParts& parts, const std::filesystem::path& folder);

}  // namespace gs
