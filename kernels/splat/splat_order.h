// SPDX-License-Identifier: Apache-2.0
// The order of the whole model's rows, for splats that came from several ranks.
#pragma once

#include "kernels/splat/projected_view.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

/// Writes the splats of all ranks in the order of row_order(). `rows` has those of each part, ascending, and
/// `of_ranks` how many rows each rank has. Does its work on the host, wherever the arrays lie.
void order_on_host(const SplatParts& splats, const RowParts& rows, const std::vector<RowCounts>& of_ranks,
                   DeviceArray<WireSplat>& out);

}  // namespace gs
