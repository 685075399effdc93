// SPDX-License-Identifier: Apache-2.0
// Writes a comparison as one self-contained HTML page.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "eval/report/comparison.h"

namespace gs {

/// Limits for the images on the page.
struct ReportOptions {
    int max_views = 3;    ///< largest number of views per scene, evenly spaced
    int max_width = 800;  ///< px; wider images are downsized
};

/// Writes the page: tables, frame times, plots (PSNR over training time and over bytes), corrections of learned
/// cameras, images with a slider, and the numerical stability of the models used, which is measured here and takes up
/// to seconds. The images are full, base, residual, reference and error, if the run folders contain them (base and
/// residual after --decompose); repeated runs show the images of the first run. The page loads no external files.
/// Throws DataError if images cannot be read or the page cannot be written.
void write_report(const std::filesystem::path& path, const Comparison& comparison, const ReportOptions& options);

/// Returns the runs of all scenes. Dataset tables repeat them and are skipped.
std::vector<const RunResult*> runs_of(const Comparison& comparison);
/// Returns the tables of the page.
std::string report_tables(const Comparison& comparison);
/// Returns a table of the runs that have frame_times, and the names of those without.
std::string report_frame_times(const Comparison& comparison);
/// Returns the measured stability of the colour activations and of the runs' models, if these are registered.
std::string report_stability(const Comparison& comparison);
/// Returns one SVG for each table and each cost that at least one line has.
std::string report_plots(const Comparison& comparison);
/// Returns the section about learned cameras: for each run that has them a plot of the corrections of its training
/// views and the pictures of the largest; empty if no run has any.
std::string report_cameras(const Comparison& comparison, const ReportOptions& options);
/// Returns JSON for the slider, safe inside a <script> element; index -1 = no such image:
///   {"gain", "images": [data URI],
///    "scenes": [{"name", "views": [name], "runs": [{"label", "layers": {"full": [index], ..}}]}]}
std::string report_pictures(const Comparison& comparison, const ReportOptions& options);

/// Text of eval/report/report_page.html: the body of write_report's page, with the placeholders {{tables}}, {{frames}},
/// {{plots}}, {{cameras}}, {{stability}}, {{program}} and {{pictures}} in this order.
extern const char* const kReportPage;

}  // namespace gs
