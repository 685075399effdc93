// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "kernels/densify/densify.h"

namespace gs::test {

/// Removes the share `ratio` of lowest scores from a model on the host. Returns the number of removed rows.
inline std::int64_t remove_lowest_scores(Gaussians& state, const std::vector<float>& scores, double ratio) {
    const std::int64_t before = state.count;
    gather_rows(state, rows_of_highest_scores(scores, ratio));
    return before - state.count;
}

}  // namespace gs::test
