// SPDX-License-Identifier: Apache-2.0
// A finished run, or a point cloud without one, as a web page that shows it, or as a file for other programs, and what
// it loses when it is packed.
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
    double packed_psnr = 0;  ///< dB, of the decoded file, drawn and corrected the same way
};

/// Returns the mean PSNR of the test views as the decoded file shows them, as packing_loss measures it.
double packed_psnr(SavedRun& run, const PackedScene& scene);

/// Scores the model and the decoded file against the photographs by the protocol `paper`. The decoded colours of each
/// view are evaluated in double and drawn as a model without view dependence. Throws UsageError without test views.
PackingLoss packing_loss(SavedRun& run, const PackedScene& scene);

/// Returns the photometric block of a run with PPISP, with the corrections of `views`. Renders each of them once.
PackedPpisp packed_correction(SavedRun& run, const std::vector<View>& views);

struct ExportRequest {
    std::filesystem::path run;                   ///< folder of the run, or a point cloud
    std::optional<std::int64_t> iteration = {};  ///< saved iteration; empty: the last
    std::filesystem::path output;                ///< folder to write to
    bool is_file = false;                        ///< `output` is the name of the file itself (export_file)
    bool overwrite = false;                      ///< replace an earlier export there
    /// The axis that is to point up: "y", "z" or "-y". The model is turned from where its cameras say up is. Empty: it
    /// stays as it is.
    std::string up = {};
    /// Whether .ngsplat files store a residual for every Gaussian, as the paper's viewer expects it.
    bool compatible = false;
    RunChanges changes = {};  ///< what open_saved_run is to change
};

/// What only a site has.
struct SiteOptions {
    std::filesystem::path second_run = {};  ///< another run of the scene, to compare with; empty: none
    bool levels = false;                    ///< also write coarser levels of the (first) run
    int photographs = 0;                    ///< write the photographs of at most so many test views, evenly spread
    std::string title = {};                 ///< of the page; empty: the scene's name
    std::string start_view = {};            ///< what the page begins with (find_start_view); empty: its own choice
    std::string url = {};                   ///< address of the page's folder, for previews of links; empty: unknown
};

/// A model as it was written.
struct ExportedModel {
    std::filesystem::path file;
    std::int64_t num_gaussians = 0;
    std::optional<PackingLoss> loss = {};  ///< what packing for the web costs on the test views, if there are any
};

/// Writes scene.ngsplat and, if the web viewer is built, the viewer with a preview image for links to it. Measures the
/// loss of packing on the test views, and writes it to the log and the file. A second run becomes scene-2.ngsplat,
/// levels (coarser_levels) become scene-level-K.ngsplat. site.json names what lies beside scene.ngsplat, if there is
/// anything, with the PSNR of each level. Throws UsageError if the output is taken, the two runs have other cameras,
/// or there are no test views whose photographs could be written; what find_start_view and open_saved_run throw;
/// DataError for parameters that are not finite and if a file cannot be read or written; and what turn
/// (lib/export/turn.h) throws.
std::vector<ExportedModel> export_web(const ExportRequest& request, const SiteOptions& site = {});

enum class SplatFormat {
    kPly,    ///< point_cloud.ply as 3DGS writes it
    kSplat,  ///< point_cloud.splat: one colour a Gaussian, 32 bytes
};

/// Writes the file. With `sh_projection` a PLY holds spherical harmonics of degree 3 that are fitted to the colours of
/// any appearance model (project_to_sh). The log says what the file cannot hold. Throws as export_web; to turn
/// the model it needs the run's cameras.json, or the scene of a point cloud.
ExportedModel export_file(const ExportRequest& request, SplatFormat format, bool sh_projection);

}  // namespace gs
