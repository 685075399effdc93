// SPDX-License-Identifier: Apache-2.0
// Writes and reads checkpoints: everything that a run needs to continue, in one safetensors file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// The time of a training, including all its parts if it was resumed.
struct TrainingTime {
    double train_seconds = 0;      ///< time of the training loop, without loading, saving and evaluation
    double data_wait_seconds = 0;  ///< part of train_seconds spent waiting for images
    double limited_seconds = 0;    ///< time counted by a time limit: all since the first step except evaluations
};

/// The state of cameras that are learned (lib/train/camera_refinement.h).
struct CameraState {
    static constexpr std::size_t kViewValues = 32, kLensValues = 10;
    std::vector<std::vector<double>> views, lenses;  ///< kViewValues for each view, kLensValues for each lens
    std::int64_t gathered = 0;                       ///< number of gradients since the cameras' last step
};

struct Checkpoint {
    Gaussians state;             ///< parameters, Adam moments (may be absent), Adam step, active degree, appearance
    std::int64_t iteration = 0;  ///< number of finished iterations
    /// The complete state of the random generator, because random numbers are functions of (seed, iteration).
    std::uint64_t seed = 0;
    std::string options_yaml = {};  ///< resolved options of the run
    /// The view_digest of the test views, so that a resumed run does not score views on which an earlier part was
    /// trained; empty in files of versions that did not store it
    std::string test_views = {};
    Frame frame = {};  ///< frame of the Gaussians; identity in files of earlier versions
    /// The time of the iterations; empty in files of versions that did not store it
    std::optional<TrainingTime> time = {};
    CameraState cameras = {};  ///< empty unless cameras are learned
    bool automatic = false;    ///< written because of the elapsed time; removed once there is a newer checkpoint
};

/// Writes the checkpoint atomically and without a second copy in memory: 12 bytes per parameter with moments, 4
/// without. The tensors are named by the groups of gaussian_state.h, "adam_m.<group>" and "adam_v.<group>". With ADC
/// there are also "gradient_sum" and "gradient_count"; for an antialiased model "smoothing", without moments; if only
/// visible Gaussians take steps, "last_step"; with PPISP, "ppisp" and, once there are controllers, "controller", each
/// with one row and its moments; with learned cameras, "camera_views" and "camera_lenses" in double precision.
/// Everything else is metadata.
void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint);

/// Read only the frame, or only the iteration, of a checkpoint. Throw DataError.
Frame read_checkpoint_frame(const std::filesystem::path& path);
std::int64_t read_checkpoint_iteration(const std::filesystem::path& path);

/// Reads a checkpoint bit for bit. Throws DataError naming file, tensor, row or metadata key for a file that is not a
/// checkpoint, is truncated, disagrees with its appearance model, or holds values that are not finite.
Checkpoint read_checkpoint(const std::filesystem::path& path);

/// Returns whether the file is an automatic checkpoint; false if it is not a checkpoint. Reads only its header.
bool is_automatic_checkpoint(const std::filesystem::path& path);

}  // namespace gs
