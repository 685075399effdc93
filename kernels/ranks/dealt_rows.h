// SPDX-License-Identifier: Apache-2.0
// The rows of a model dealt to ranks like cards: row i to rank i modulo the number of ranks. So each rank has a fair
// sample of every place in the scene, and as much work as the others in every view.
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

/// Returns the number of rows dealt to a rank.
inline std::int64_t dealt_count(std::int64_t rows, int ranks, int rank) {
    return rows / ranks + (rank < rows % ranks ? 1 : 0);
}

/// Returns the rows of all ranks in the order of the whole model: rows with a residual first, in dealing order.
std::vector<DealtRow> row_order(const std::vector<RowCounts>& ranks);

/// Returns the part of the model dealt to a rank. Every part includes the shared weights and PPISP.
Gaussians dealt_part(const Gaussians& model, int ranks, int rank);

/// Joins the ranks' parts into the whole model, in the order of row_order.
Gaussians joined(const std::vector<Gaussians>& parts);

/// Returns the number of Gaussians that each rank may have for a total of `total`: as even as possible without removing
/// any. A rank without Gaussians gets none.
std::vector<std::int64_t> even_shares(const std::vector<RowCounts>& ranks, std::int64_t total);

}  // namespace gs
