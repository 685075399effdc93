// SPDX-License-Identifier: Apache-2.0
// Writes and reads checkpoints: all that a run needs to continue, in one safetensors file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// The time of a training: of all its parts, if it was resumed.
struct TrainingTime {
    double train_seconds = 0;      ///< the loop; without loading, saving and evaluation
    double data_wait_seconds = 0;  ///< part of train_seconds spent waiting for images
    double limited_seconds = 0;    ///< what counts towards a time limit: all since the first step but evaluations
};

struct Checkpoint {
    Gaussians state;             ///< parameters, Adam moments (may be absent), Adam step, active degree, appearance
    std::int64_t iteration = 0;  ///< iterations done
    /// The seed is the whole state of the random generator, because random numbers are functions of (seed, iteration).
    std::uint64_t seed = 0;
    std::string options_yaml;  ///< resolved options of the run
    /// view_digest of the test views, so that a resumed run does not score what an earlier part trained on; empty in
    /// files of versions that did not store it
    std::string test_views = {};
    Frame frame = {};  ///< frame that the Gaussians are in; identity in files of earlier versions
    /// The time that the iterations took; empty in files of versions that did not store it
    std::optional<TrainingTime> time = {};
    bool automatic = false;  ///< written for the time that had passed, and removed once there is a newer one
};

/// Writes the checkpoint atomically and without a second copy of it: 12 bytes per parameter with moments, 4 without.
/// The tensors have the group names of gaussian_state.h, "adam_m.<group>" and "adam_v.<group>"; with ADC also
/// "gradient_sum" and "gradient_count"; if only visible Gaussians take steps also "last_step"; with PPISP also
/// "ppisp" and, once there are controllers, "controller", each one row and its moments. Everything else is metadata.
void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint);

/// Reads the frame, or the iteration, of a checkpoint and nothing else. Throws DataError.
Frame read_checkpoint_frame(const std::filesystem::path& path);
std::int64_t read_checkpoint_iteration(const std::filesystem::path& path);

/// Reads a checkpoint bit for bit. Throws DataError naming file, tensor, row or metadata key for a file that is no
/// checkpoint, is truncated, disagrees with its appearance model, or holds values that are not finite.
Checkpoint read_checkpoint(const std::filesystem::path& path);

/// Returns whether the file is a checkpoint that was written automatically. Reads only its header; false for a file
/// that is none.
bool is_automatic_checkpoint(const std::filesystem::path& path);

}  // namespace gs
