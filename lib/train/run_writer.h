// SPDX-License-Identifier: Apache-2.0
// Writes the files of a run except its log: configuration, cameras, first points, checkpoints, point clouds, previews.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/model/checkpoint.h"
#include "lib/model/run_folder.h"
#include "lib/scene/scene.h"
#include "lib/train/photometric.h"
#include "lib/train/train_log.h"

namespace gs {

/// Writes the files of a run folder: call write_start() or write_config() first, then the other functions in any order.
/// All functions throw DataError when a write fails. The referenced objects must outlive this one.
class RunWriter {
  public:
    /// Keeps `lock`, which may be null; nothing is written once the locked folder is gone. `cameras` is as in RunStart.
    /// `tensorboard`, which may be null, receives the previews.
    RunWriter(RunFolder folder, std::shared_ptr<const RunLock> lock, std::string cameras, const TrainOptions& options,
              const Scene& scene, const Photometric& photometric, TensorBoard* tensorboard);

    const RunFolder& folder() const { return folder_; }
    /// Throws DataError if the folder was removed or replaced. All functions that write files call it first.
    void check_folder() const {
        if (lock_) lock_->check_folder();
    }

    /// Writes the files of a new run before its first step: config.yaml, cfg_args, cameras.json, input.ply.
    void write_start(const PointCloud& first_points) const;
    /// Writes config.yaml, cfg_args and cameras.json, also for a resumed run, whose options may have changed.
    void write_config() const;

    /// Writes the cameras that were learned: to cameras.json, and as a scene of their own. `corrections` says how far
    /// each training view's moved, in pixels.
    void write_refined_cameras(const std::vector<double>& corrections) const;
    /// Writes everything that the run needs to continue, including Adam moments, and removes automatic checkpoints of
    /// earlier iterations. Completes the checkpoint by what is the same in the whole run.
    void write_checkpoint(Checkpoint checkpoint) const;
    /// Returns the time for reading the model back from the device and writing its point cloud, in seconds per
    /// Gaussian. Leaves no file.
    double seconds_per_gaussian(Backend& backend) const;
    /// Writes the point cloud in the format of 3DGS viewers, and ppisp.json.
    void write_point_cloud(Backend& backend, std::int64_t iteration) const;
    void write_ppisp(Backend& backend, std::int64_t iteration) const {
        check_folder();
        photometric_.save(folder_.ppisp(), backend, iteration);
    }
    /// Writes a render of the first test view, or of the first training view if there is none.
    void write_preview(Backend& backend, const Vec3<float>& background, std::int64_t iteration) const;
    /// Adds the same render to TensorBoard only.
    void show_preview(Backend& backend, const Vec3<float>& background, std::int64_t iteration) const;

  private:
    Image preview(Backend& backend, const Vec3<float>& background) const;
    void save_points(const std::filesystem::path& path, const Gaussians& gaussians, std::int64_t iteration) const;

    const RunFolder folder_;
    const std::shared_ptr<const RunLock> lock_;
    const std::string cameras_;
    const std::string config_, cfg_args_;  ///< texts of config.yaml and cfg_args
    const std::uint64_t seed_;
    const std::int64_t cap_;
    const Scene& scene_;
    const Photometric& photometric_;
    TensorBoard* const tensorboard_;
};

}  // namespace gs
