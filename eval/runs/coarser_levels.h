// SPDX-License-Identifier: Apache-2.0
// Coarser levels of a model, for devices without the memory or the speed for all of it.
#pragma once

#include <cstdint>
#include <vector>

#include "lib/export/coarser.h"

namespace gs {

/// The most levels beside the whole model. Each has half the Gaussians of the one before.
inline constexpr int kMostLevels = 4;

/// Returns the numbers of Gaussians of the levels of a model with `count`: halves as long as they have at least those
/// that the textures of a file have room for anyway (ngsplat_unit), so that a coarser level is a smaller file.
std::vector<std::int64_t> level_counts(std::int64_t count);

/// Returns the levels of `model`, the largest first; `scores` has one value per row (Backend::scores).
std::vector<CoarserModel> coarser_levels(const Gaussians& model, const std::vector<float>& scores);

}  // namespace gs
