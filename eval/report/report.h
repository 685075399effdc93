// SPDX-License-Identifier: Apache-2.0
// Writes a comparison as one HTML page that needs no other file.
#pragma once

#include <filesystem>
#include <string>

#include "eval/report/comparison.h"

namespace gs {

/// The limits of the pictures on the page.
struct ReportOptions {
    int max_views = 3;    ///< most views of a scene that are shown, evenly spread
    int max_width = 800;  ///< px; wider pictures are shrunk
};

/// Writes the page: tables, frame times, plots (PSNR over training time and over bytes), pictures with a slider, and
/// the stability of the models that occur, which is measured here and takes up to seconds. The pictures are full, base,
/// residual, reference and error, as far as the run folders hold them (base and residual after --decompose); repeated
/// runs show those of the first run. The page loads nothing from elsewhere. Throws DataError when pictures cannot be
/// read or the page cannot be written.
void write_report(const std::filesystem::path& path, const Comparison& comparison, const ReportOptions& options);

/// Returns the tables of the page.
std::string report_tables(const Comparison& comparison);
/// Returns a table of the runs that have frame_times, and the names of those without.
std::string report_frame_times(const Comparison& comparison);
/// Measures the colour activations and those models of the runs that are registered.
std::string report_stability(const Comparison& comparison);
/// Returns one SVG for each table and each cost that at least one line has.
std::string report_plots(const Comparison& comparison);
/// Returns JSON for the slider, safe inside a <script> element; index -1 = no such picture:
///   {"gain", "images": [data URI],
///    "scenes": [{"name", "views": [name], "runs": [{"label", "layers": {"full": [index], ..}}]}]}
std::string report_pictures(const Comparison& comparison, const ReportOptions& options);

/// The text of eval/report/report_page.html: the body of write_report's page, with the placeholders {{tables}},
/// {{frames}}, {{plots}}, {{stability}}, {{program}} and {{pictures}} in this order.
extern const char* const kReportPage;

}  // namespace gs
