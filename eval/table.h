// SPDX-License-Identifier: Apache-2.0
// A table over several runs, made from their results.json alone.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "eval/metrics.h"

namespace gs {

/// One evaluated model. Fields that the file does not know stay empty and are shown as "-".
struct TableRow {
    std::string run, scene, model, strategy;
    std::int64_t iteration = 0;
    std::optional<std::int64_t> num_gaussians;
    double psnr = 0, ssim = 0;  ///< psnr may be infinite
    std::map<std::string, MetricScore> scores;  ///< of further metrics, by MetricInfo::key
    std::optional<double> train_seconds;
    std::optional<double> frame_seconds;  ///< not in the table
    std::optional<std::int64_t> peak_device_bytes;  ///< of training on a GPU
    std::string correction;     ///< photometric, by correction_name; scores of different ones do not compare
    std::string ssim_protocol;  ///< how SSIM was computed; rows with different ones do not compare
};

enum class TableFormat { kMarkdown, kCsv, kLatex };

/// markdown | csv | latex. Throws UsageError naming these.
TableFormat parse_table_format(const std::string& name);

/// Scores of the given iteration of a run, of the last evaluated one when `iteration` is empty. Files of other programs
/// that have the 3DGS keys are read as well. Throws DataError naming file and field.
TableRow read_table_row(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration);

/// Further metrics follow SSIM where any row has a score or the reason why there is none, which then stands below the table
/// (Markdown) or is left out. Columns run, scene, model, strategy, ppisp (how views were corrected), #Gs, PSNR, SSIM, train time, peak memory (of the GPU); ends with a newline. CSV
/// carries full numbers (times in seconds, memory in bytes), the others are rounded for reading.
std::string format_table(const std::vector<TableRow>& rows, TableFormat format);

}  // namespace gs
