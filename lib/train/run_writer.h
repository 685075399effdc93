// SPDX-License-Identifier: Apache-2.0
// Writes the files of a run: configuration, cameras, first points, training log, checkpoints, point clouds, previews.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/model/checkpoint.h"
#include "lib/model/run_folder.h"
#include "lib/scene/scene.h"
#include "lib/train/densification.h"
#include "lib/train/photometric.h"
#include "lib/train/train_log.h"

namespace gs {

/// Writes the files of a run folder. All members throw DataError when a write fails. The referenced objects must
/// outlive this one.
class RunWriter {
  public:
    /// `lock`, which may be null, is held; nothing is written once its folder is gone. `cameras` as in RunStart.
    /// `tensorboard`, which may be null, gets the lines of the log and the previews.
    RunWriter(RunFolder folder, std::shared_ptr<const RunLock> lock, std::string cameras, const TrainOptions& options,
              const Scene& scene, const Photometric& photometric, TensorBoard* tensorboard);

    const RunFolder& folder() const { return folder_; }
    /// Throws DataError when the folder was removed or replaced. All other members call it first.
    void check_folder() const {
        if (lock_) lock_->check_folder();
    }

    /// Writes the files of a new run before its first step: config.yaml, cfg_args, cameras.json, input.ply.
    void write_start(const PointCloud& first_points) const;
    /// Writes config.yaml, cfg_args and cameras.json, also of a resumed run, whose options may have changed.
    void write_config() const;

    /// Opens stats/train.jsonl and keeps its lines up to `iteration`; `at_end` as for TrainLog. Must be called before
    /// the first line is written.
    void open_log(std::int64_t iteration, bool at_end);
    const TrainLog& opened_log() const { return *log_; }
    /// Writes one line, which must have "event" and "iteration".
    void log(nlohmann::json line) {
        check_folder();  // or the lines would go to a file that nobody can find any more
        if (lines_are_final_) line["final"] = true;
        log_->write(line);
        if (tensorboard_) tensorboard_->add_line(line);
    }
    /// Marks all further lines as "final": they come after the last checkpoint, and who resumes from it writes them
    /// again.
    void begin_final_lines() { lines_are_final_ = true; }
    /// Must be called after the last line. Throws DataError when lines are missing in the file.
    void close_log() { log_->close(); }
    /// Writes the lines of a change in the set of Gaussians before or after the step of `iteration` (1-based); none if
    /// nothing changed.
    void log_change(const ScheduledChange& change, std::int64_t iteration);

    /// Writes everything that the run needs to continue, moments included, and removes automatic checkpoints of
    /// earlier iterations. `time` is that of the training so far, if it is known.
    void write_checkpoint(Gaussians state, std::int64_t iteration, const std::optional<TrainingTime>& time,
                          bool automatic = false) const;
    /// Returns the seconds that reading the model back and writing its point cloud take for each Gaussian. Leaves no
    /// file.
    double seconds_per_gaussian(Backend& backend) const;
    /// Writes the point cloud as 3DGS viewers read it, and ppisp.json.
    void write_point_cloud(Backend& backend, std::int64_t iteration) const;
    void write_ppisp(Backend& backend, std::int64_t iteration) const {
        check_folder();
        photometric_.save(folder_.ppisp(), backend, iteration);
    }
    /// Writes a render of the first test view, or of the first training view if there is none.
    void write_preview(Backend& backend, const Vec3<float>& background, std::int64_t iteration) const;
    /// Shows the same picture in TensorBoard alone.
    void show_preview(Backend& backend, const Vec3<float>& background, std::int64_t iteration) const;

  private:
    Image preview(Backend& backend, const Vec3<float>& background) const;
    void save_points(const std::filesystem::path& path, const Gaussians& gaussians, std::int64_t iteration) const;

    const RunFolder folder_;
    const std::shared_ptr<const RunLock> lock_;
    const std::string cameras_;
    const std::string config_, cfg_args_;  ///< the texts of these files
    const std::uint64_t seed_;
    const std::int64_t cap_;
    const Scene& scene_;
    const Photometric& photometric_;
    TensorBoard* const tensorboard_;
    std::optional<TrainLog> log_;
    bool lines_are_final_ = false;
};

}  // namespace gs
