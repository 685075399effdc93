// SPDX-License-Identifier: Apache-2.0
// The lists of a view's tiles (kernels/sort/binning_cuda.h) for host code.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/splat/wire_splat.h"

namespace gs::test {

/// The size of a tile in pixels.
inline constexpr int kTileX = 16, kTileY = 12;

struct ListsOnDevice {
    std::uint64_t num_instances;
    std::uint32_t num_visible;
    bool stopped;
    bool cleared;                                 ///< whether the words that were to be set to 0 are
    std::vector<std::uint32_t> counts, depths;    ///< of each splat; the depth's key
    std::vector<std::uint32_t> offsets;           ///< (tiles+1)
    std::vector<std::uint32_t> instances;         ///< splats, or slots
    std::vector<std::uint32_t> gaussians;         ///< only with slots: the splat of each
    std::vector<std::uint32_t> order, slot_ends;  ///< only with slots: visible splats, and where the slots of each end
    std::vector<std::uint32_t> tiles_worked_on;   ///< each once
};

/// Lists the splats of a view by tile and depth. There is room for `room` instances.
ListsOnDevice list_on_device(const std::vector<WireSplat>& splats, int width, int height, std::int64_t room,
                             bool with_slots);

}  // namespace gs::test
