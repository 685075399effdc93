// SPDX-License-Identifier: Apache-2.0
// A comparison as one HTML page that needs nothing beside it.
#pragma once

#include <filesystem>
#include <string>

#include "eval/report/comparison.h"

namespace gs {

struct ReportOptions {
    int max_views = 3;   ///< pictures of that many views a scene, evenly spread
    int max_width = 800; ///< wider pictures are shrunk, px
};

/// Tables, frame times, plots (PSNR over training time and over bytes), a slider between full, base, residual, reference and error pictures, as
/// far as the run folders hold them (base and residual: after --decompose), and the stability of the appearance models that occur,
/// which is measured here and takes up to seconds. Of repeated runs the first one's pictures are shown. Nothing is loaded from elsewhere.
/// Throws DataError when pictures cannot be read or the page cannot be written.
void write_report(const std::filesystem::path& path, const Comparison& comparison, const ReportOptions& options);

/// The tables of the page.
std::string report_tables(const Comparison& comparison);
/// One line for each run with frame_times, and the names of those without.
std::string report_frame_times(const Comparison& comparison);
/// Measures the colour activations and the models of the runs, as far as they are registered.
std::string report_stability(const Comparison& comparison);
/// One SVG for each table and cost that at least one line has.
std::string report_plots(const Comparison& comparison);
/// JSON for the slider: {"images": [data URI], "scenes": [{"name", "views": [name], "runs": [{"label", "layers": {"full": [index], ..}}]}]};
/// index -1 = no such picture. Safe inside a <script> element.
std::string report_pictures(const Comparison& comparison, const ReportOptions& options);

}  // namespace gs
