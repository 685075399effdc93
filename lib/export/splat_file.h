// SPDX-License-Identifier: Apache-2.0
// Writes the .splat file of antimatter15's viewer: 32 bytes per Gaussian, one colour for all directions
// (docs/formats.md).
#pragma once

#include <filesystem>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// Writes position and standard deviations (float), colour and opacity, rotation w x y z (bytes), largest and most
/// opaque first, atomically. `gaussians` must have the appearance model none with relu (project_to_sh with degree 0).
/// Throws DataError if the write fails. `gaussians` are in `frame`; the file has scene coordinates minus
/// file_offset(frame).
void write_splat(const std::filesystem::path& path, const Gaussians& gaussians, const Frame& frame);

}  // namespace gs
