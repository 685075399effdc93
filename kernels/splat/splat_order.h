// SPDX-License-Identifier: Apache-2.0
// The order of the whole model's rows (row_order()) for splats that came from several ranks.
#pragma once

#include <cstdint>

#include "kernels/base/portable.h"
#include "kernels/splat/projected_view.h"
#include "kernels/splat/wire_splat.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

/// The splats that one rank sent, and their rows, ascending. The first `num_residuals` rows of the rank have a
/// residual.
struct SplatsOfRank {
    const WireSplat* splats;
    const std::uint32_t* rows;
    std::int64_t num, num_residuals;
};

/// Returns a sort key for the order of row_order(): rows with a residual first, then row, then rank.
GS_HD std::uint64_t order_of_row(const SplatsOfRank& part, std::int64_t k, int rank) {
    const std::uint64_t row = part.rows[k];
    return (std::int64_t(row) < part.num_residuals ? 0 : std::uint64_t(1) << 63) | row << 31 | std::uint64_t(rank);
}

/// Returns the place of splat `k` of a rank among the splats of all ranks.
GS_HD std::int64_t place_in_order(const SplatsOfRank* parts, int num_ranks, int rank, std::int64_t k) {
    const std::uint64_t mine = order_of_row(parts[rank], k, rank);
    std::int64_t place = k;
    for (int other = 0; other < num_ranks; ++other) {
        if (other == rank) continue;
        // Binary search between these two for the first splat after `mine`.
        std::int64_t begin = 0, end = parts[other].num;
        while (begin < end) {
            const std::int64_t middle = begin + (end - begin) / 2;
            if (order_of_row(parts[other], middle, other) < mine)
                begin = middle + 1;
            else
                end = middle;
        }
        place += begin;
    }
    return place;
}

/// Writes the splats of all ranks in the order of row_order(). `rows` holds the rows of each part, ascending, and
/// `of_ranks` the row counts of each rank. Runs on the host, wherever the arrays lie.
void order_on_host(const SplatParts& splats, const RowParts& rows, const std::vector<RowCounts>& of_ranks,
                   DeviceArray<WireSplat>& out);

}  // namespace gs
