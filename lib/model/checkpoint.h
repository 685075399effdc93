// SPDX-License-Identifier: Apache-2.0
// Everything a run needs to go on, in one safetensors file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "kernels/model/gaussian_state.h"

namespace gs {

struct Checkpoint {
    Gaussians state;             ///< parameters, Adam moments (may be absent), Adam step, active degree, appearance
    std::int64_t iteration = 0;  ///< iterations done
    /// Random numbers are functions of (seed, iteration), so this is the whole state of the random generator.
    std::uint64_t seed = 0;
    std::string options_yaml;  ///< resolved options of the run
};

/// Writes the checkpoint atomically and without a second copy of it: 12 bytes per parameter with moments, 4 without.
/// Tensors: the group names of gaussian_state.h, "adam_m.<group>", "adam_v.<group>", with ADC also
/// "gradient_sum" and "gradient_count"; with PPISP "ppisp" and, once there are some, "controller", each one row with moments
/// likewise; all else is metadata.
void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint);

/// Reads it back bit for bit. Throws DataError naming file, tensor, row or metadata key for a file that is no
/// checkpoint, is truncated, disagrees with its appearance model, or holds values that are not finite.
Checkpoint read_checkpoint(const std::filesystem::path& path);

}  // namespace gs
