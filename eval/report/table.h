// SPDX-License-Identifier: Apache-2.0
// Reads the row of a table from a run folder's files alone.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "eval/bench/frame_times.h"
#include "lib/core/train_options.h"

namespace gs {

/// One evaluated model. Facts that the files do not hold stay empty.
struct TableRow {
    std::filesystem::path folder;  ///< the run folder
    std::string run, dataset, scene, model, strategy;
    std::int64_t iteration = 0;
    std::optional<std::int64_t> num_gaussians;
    double psnr = 0, ssim = 0;                        ///< psnr in dB, may be infinite
    std::map<std::string, double> further_metrics;    ///< scores by their names in results.json
    std::map<std::string, std::string> not_measured;  ///< reason by name, for metrics that were asked for
    std::optional<double> train_seconds;
    std::optional<double> frame_seconds;
    std::optional<FrameTimes> frame_times;           ///< result of `gsapp bench frames`
    std::optional<std::int64_t> peak_device_bytes;   ///< peak of training on a GPU
    std::optional<double> residual_share;            ///< of a mixed model: share of Gaussians with a residual
    std::optional<std::int64_t> bytes_per_gaussian;  ///< mean size of the appearance
    /// Mean sizes of a whole Gaussian in point_cloud.ply and in scene.ngsplat
    std::optional<std::int64_t> ply_bytes_per_gaussian, web_bytes_per_gaussian;
    std::optional<std::int64_t> planned_bytes;  ///< size of the file that a size limit is for
    std::string correction;     ///< photometric, by correction_name; scores of different ones do not compare
    std::string protocol_name;  ///< one of protocols(); empty: the file does not say
    std::string protocol;       ///< protocol_line; rows with different ones do not compare
    std::uint64_t seed = 0;
    std::map<std::string, std::string> training;  ///< training_options of config.yaml; empty without one
};

/// Reads the scores of one iteration of a run, or of the last evaluated one when `iteration` is empty. Also reads files
/// of other programs that have the 3DGS keys. Throws DataError naming file and field.
TableRow read_table_row(const std::filesystem::path& run_folder, std::optional<std::int64_t> iteration);

/// Adds seed and training options from the run's config.yaml. Leaves the row as it is where that cannot be read.
void read_training(TableRow& row, const std::filesystem::path& run_folder);

/// Returns whether the folder options.model holds a run of the same training options and seed.
bool holds_same_run(const TrainOptions& options);

/// Returns the row of the run that holds_same_run finds if it has ended; empty otherwise.
std::optional<TableRow> finished_run(const TrainOptions& options);

/// Throws UsageError naming runs and protocols unless all rows have one protocol, or all state none.
void require_one_protocol(const std::vector<TableRow>& rows);

}  // namespace gs
