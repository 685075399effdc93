// SPDX-License-Identifier: Apache-2.0
// Exports a finished run, or a point cloud without a run, as a web page or as a file for other programs, and measures
// the loss from packing.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/runs/saved_run.h"
#include "lib/export/ngsplat.h"

namespace gs {

/// The scores before and after packing.
struct PackingLoss {
    double psnr = 0;         ///< dB, of the model; mean over the test views
    double packed_psnr = 0;  ///< dB, of the decoded file, rendered and corrected the same way
};

/// Returns the mean PSNR of the test views rendered from the decoded file, as packing_loss measures it.
double packed_psnr(SavedRun& run, const PackedScene& scene);

/// Scores the model and the decoded file against the photographs by the protocol `paper`. The decoded colours of each
/// view are evaluated in double and rendered as a model without view dependence. Throws UsageError without test views.
PackingLoss packing_loss(SavedRun& run, const PackedScene& scene);

/// Returns the photometric block of a run with PPISP, with the corrections of `views`. Renders each view once.
PackedPpisp packed_correction(SavedRun& run, const std::vector<View>& views);

struct ExportRequest {
    std::filesystem::path run;                   ///< folder of the run, or a point cloud
    std::optional<std::int64_t> iteration = {};  ///< saved iteration; empty: the last
    std::filesystem::path output;                ///< folder to write to
    bool is_file = false;                        ///< whether `output` is the name of the file itself (export_file)
    bool overwrite = false;                      ///< whether to replace an earlier export there
    /// Axis that is to point up: "y", "z" or "-y". The model is rotated so that the up direction of its cameras becomes
    /// this axis. Empty: the model is not rotated.
    std::string up = {};
    /// Whether .ngsplat files store a residual for every Gaussian, as the paper's viewer expects.
    bool compatible = false;
    RunChanges changes = {};  ///< changes for open_saved_run
};

/// Options of a site only.
struct SiteOptions {
    std::filesystem::path second_run = {};  ///< another run of the scene, to compare with; empty: none
    bool levels = false;                    ///< also write coarser levels of the (first) run
    int photographs = 0;                    ///< maximum number of test views with photographs, evenly spaced
    std::string title = {};                 ///< title of the page; empty: the scene's name
    std::string start_view = {};            ///< first view of the page (find_start_view); empty: its own choice
    std::string url = {};                   ///< address of the page's folder, for link previews; empty: unknown
};

/// A model that was written.
struct ExportedModel {
    std::filesystem::path file;
    std::int64_t num_gaussians = 0;
    std::optional<PackingLoss> loss = {};  ///< loss from packing on the test views, if there are any
};

/// Writes scene.ngsplat and, if the web viewer is built, the viewer with a preview image for links to it. Measures the
/// loss from packing on the test views, and writes it to the log and the file. A second run becomes scene-2.ngsplat,
/// levels (coarser_levels) become scene-level-K.ngsplat. If there are further files beside scene.ngsplat, site.json
/// lists them, with the PSNR of each level. Throws UsageError if the output already exists and `overwrite` is off, if
/// the two runs have different cameras, or if there are no test views whose photographs could be written; DataError for
/// parameters that are not finite and if a file cannot be read or written; and the errors of find_start_view,
/// open_saved_run and turn (lib/export/turn.h).
std::vector<ExportedModel> export_web(const ExportRequest& request, const SiteOptions& site = {});

enum class SplatFormat {
    kPly,    ///< point_cloud.ply as 3DGS writes it
    kSplat,  ///< point_cloud.splat: one colour per Gaussian, 32 bytes
};

/// Writes the file. With `sh_projection` a PLY contains spherical harmonics of degree 3 fitted to the colours of any
/// appearance model (project_to_sh). Logs the properties that the file cannot represent. Throws as export_web does;
/// rotating the model requires the run's cameras.json, or the scene of a point cloud.
ExportedModel export_file(const ExportRequest& request, SplatFormat format, bool sh_projection);

}  // namespace gs
