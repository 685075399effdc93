// SPDX-License-Identifier: Apache-2.0
// The rows of a model dealt to ranks like cards: row i to rank i modulo their number. So each rank has a fair sample of
// every place in the scene, and as much to do in every view as the others.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/state/gaussian_state.h"

namespace gs {

/// One row of the whole model.
struct DealtRow {
    int rank;
    std::uint32_t row;  ///< within the rank
};

/// Returns the number of rows that a rank is dealt.
inline std::int64_t dealt_count(std::int64_t rows, int ranks, int rank) {
    return rows / ranks + (rank < rows % ranks ? 1 : 0);
}

/// Returns the rows of all ranks in the order of the whole model: rows with a residual first, in the order in which
/// they are dealt.
std::vector<DealtRow> row_order(const std::vector<RowCounts>& ranks);

/// Returns the part of the model that a rank is dealt. Shared weights and PPISP are part of every one.
Gaussians dealt_part(const Gaussians& model, int ranks, int rank);

/// Puts the model together of the ranks' parts, in the order of row_order.
Gaussians joined(const std::vector<Gaussians>& parts);

/// Returns how many Gaussians each rank may have when all have `total`: as evenly as can be without taking any
/// away. One without any gets none.
std::vector<std::int64_t> even_shares(const std::vector<RowCounts>& ranks, std::int64_t total);

}  // namespace gs
