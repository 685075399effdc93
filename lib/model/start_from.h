// SPDX-License-Identifier: Apache-2.0
// A trained model as the beginning of another training.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// A model as its file has it.
struct InitialModel {
    std::filesystem::path file;
    Gaussians gaussians;
    std::optional<Frame> frame = {};  ///< the frame that they are in; empty: scene coordinates
};

/// Reads a .ply file (of gsapp, or of any program that writes 3DGS's), or the last point cloud in a run folder. Throws
/// DataError for a file that cannot be read or has no Gaussians, and UsageError for what is neither file nor folder.
InitialModel read_initial_model(const std::filesystem::path& from);

/// Returns the Gaussians in the frame of `scene` and with `appearance`, without moments. Where the file has the same
/// appearance model, its residuals stay; of plain spherical harmonics the bands that both have. Otherwise the base
/// takes the mean of the colours that sampled training cameras see, and residuals begin as those that show nothing.
Gaussians start_from(InitialModel model, const Scene& scene, const AppearanceSpec& appearance, std::uint64_t seed);

}  // namespace gs
