// SPDX-License-Identifier: Apache-2.0
// Writes each splat to its place in the order.
#include "kernels/splat/splat_order.h"

namespace gs {

void order_on_host(const SplatParts& splats, const RowParts& rows, const std::vector<RowCounts>& of_ranks,
                   DeviceArray<WireSplat>& out) {
    const std::size_t num_ranks = splats.size();
    std::vector<std::vector<WireSplat>> copied_splats(num_ranks);
    std::vector<std::vector<std::uint32_t>> copied_rows(num_ranks);
    std::vector<SplatsOfRank> parts;
    for (std::size_t r = 0; r < num_ranks; ++r)
        parts.push_back({splats[r]->on_host(copied_splats[r]).data(), rows[r].on_host(copied_rows[r]).data(),
                         std::int64_t(rows[r].size()), of_ranks[r].num_residuals});
    std::vector<WireSplat> ordered(num_splats(splats));
    for (std::size_t r = 0; r < num_ranks; ++r)
        parallel_for_rows(parts[r].num, [&](std::int64_t k) {
            ordered[std::size_t(place_in_order(parts.data(), int(num_ranks), int(r), k))] = parts[r].splats[k];
        });
    out.assign(ordered);
}

}  // namespace gs
