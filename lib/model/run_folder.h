// SPDX-License-Identifier: Apache-2.0
// The output folder of a run, laid out as 3DGS tools expect it (docs/formats.md), and the lock that reserves it for one
// run at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// A lock on a run folder (flock on its file .gsapp.lock). The system releases it when the process ends in any way, so
/// the file left by a killed run locks nothing.
class RunLock {
  public:
    /// Creates the folder if it is missing, and locks it. Throws UsageError naming folder and process if another run
    /// holds the lock, DataError if the folder cannot be created or written. On a file system without locks only warns.
    explicit RunLock(std::filesystem::path folder);
    /// Removes the lock file and releases the lock.
    ~RunLock();
    RunLock(const RunLock&) = delete;
    RunLock& operator=(const RunLock&) = delete;

    /// Returns whether a run holds the lock of the folder; false if the folder does not exist or its file system has no
    /// locks.
    static bool is_held(const std::filesystem::path& folder);

    /// Throws DataError unless the path still leads to the locked folder. Otherwise a run would continue to write into
    /// a new folder after its own was removed, and leave only part of its files there.
    void check_folder() const;

  private:
    void lock_file();

    std::filesystem::path folder_;
    int folder_fd_ = -1, file_fd_ = -1;
};

/// The paths inside a run folder. They are only computed; writers create the folders that they need.
struct RunFolder {
    std::filesystem::path root;

    std::filesystem::path config() const { return root / "config.yaml"; }
    std::filesystem::path cfg_args() const { return root / "cfg_args"; }
    std::filesystem::path cameras() const { return root / "cameras.json"; }
    std::filesystem::path input_points() const { return root / "input.ply"; }
    std::filesystem::path results() const { return root / "results.json"; }
    std::filesystem::path per_view() const { return root / "per_view.json"; }
    std::filesystem::path ppisp() const { return root / "ppisp.json"; }
    /// The scene with refined cameras: a COLMAP model in sparse/0, transforms.json, and a link to the photographs.
    std::filesystem::path refined_scene() const { return root / "refined"; }
    /// Returns the picture of a training view whose camera was corrected much: refined/corrections/0.jpg is that of the
    /// largest correction.
    std::filesystem::path correction(std::size_t rank) const;
    static constexpr std::size_t kCorrections = 10;  ///< largest number of these pictures
    std::filesystem::path appearance_choice() const { return root / "auto.json"; }
    std::filesystem::path train_log() const { return root / "stats" / "train.jsonl"; }
    std::filesystem::path point_cloud(std::int64_t iteration) const;
    std::filesystem::path checkpoint(std::int64_t iteration) const;
    /// Returns preview/000500.png for iteration 500.
    std::filesystem::path preview(std::int64_t iteration) const;
    /// Return the paths of a "test" or "train" view of an iteration: <split>/ours_N/renders/00007.png and
    /// .../gt/00007.png.
    std::filesystem::path render(const std::string& split, std::int64_t iteration, int index) const;
    std::filesystem::path ground_truth(const std::string& split, std::int64_t iteration, int index) const;
    /// Returns the path of a part of the render: <split>/ours_N/base/00007.png and .../residual/00007.png.
    std::filesystem::path picture_part(const std::string& split, std::int64_t iteration, const std::string& part,
                                       int index) const;
};

/// Throws UsageError if a run must not begin or continue in the folder. Changes nothing. `resume_iteration` is the
/// iteration from which a resumed run continues; empty for a new run.
///  - A folder with a run (a config.yaml written by gsapp) is refused for a new run. It is refused for a resumed run if
///    it contains checkpoints of a later iteration, or later point clouds without the resumed checkpoint. (With that
///    checkpoint they are from the same run, killed before its next checkpoint, and the resumed run replaces them.)
///    `overwrite` permits all of these.
///  - Another folder is refused if it contains a file or folder with a name that a run writes: --overwrite replaces
///    only runs, not other files. It is also refused if it is not empty, unless `overwrite` is set.
void require_free_run_folder(const RunFolder& folder, bool overwrite,
                             std::optional<std::int64_t> resume_iteration = std::nullopt);

/// Prepares the folder before any work begins: creates it, tests that files can be written, removes temporary files of
/// killed runs, and calls require_free_run_folder. Throws what that throws, and DataError if the folder cannot be
/// created or written.
void prepare_run_folder(const RunFolder& folder, bool overwrite,
                        std::optional<std::int64_t> resume_iteration = std::nullopt);

/// Writes config.yaml, the first file of the new run. Only after that file is on the disk, removes the earlier run's
/// files, or when resuming the files of later iterations. So on a full disk the earlier run remains unchanged. Files
/// that gsapp did not write are never touched. Throws DataError.
void replace_earlier_run(const RunFolder& folder, const std::string& config,
                         std::optional<std::int64_t> resume_iteration = std::nullopt);

/// Returns the checkpoint of the highest iteration in the folder. Throws DataError if there is none.
std::filesystem::path latest_checkpoint(const std::filesystem::path& run_folder);

/// Removes the automatic checkpoints of iterations below `iteration`. Warns of checkpoints that cannot be removed.
void remove_automatic_checkpoints(const RunFolder& folder, std::int64_t iteration);

/// Returns the highest iteration with a point cloud in the folder. Throws DataError if there is none.
std::int64_t latest_point_cloud(const std::filesystem::path& run_folder);

/// Returns the highest iteration with a point cloud or a checkpoint in the folder; empty if nothing was saved.
std::optional<std::int64_t> latest_saved(const std::filesystem::path& run_folder);

/// Returns the last iteration of a finished run with these options in options.model: options.iterations, or if the run
/// does not end by iterations that of the latest point cloud. Returns nothing if there is no point cloud of that
/// iteration.
std::optional<std::int64_t> ended_at(const TrainOptions& options);

/// Writes cfg_args, the Namespace(...) text of the 3DGS trainer. sh_degree is the degree of the PLY: 0 for models other
/// than plain spherical harmonics.
std::string cfg_args(const RunFolder& folder, const TrainOptions& options);

/// Writes input.ply: x y z nx ny nz (float, normals 0) red green blue (uchar). `points` are in the frame; the file has
/// the coordinates of the run's other PLY files.
void write_input_points(const RunFolder& folder, const PointCloud& points, const Frame& frame);

}  // namespace gs
