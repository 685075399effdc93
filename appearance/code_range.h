// SPDX-License-Identifier: Apache-2.0
// What range a scene's codes of few bits cover: a choice between coarse steps for all and a few outliers that are cut
// off.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/state/gaussian_state.h"

namespace gs {

struct SampledRow {
    std::int64_t row;
    double stands_for;  ///< rows of the scene
};

/// The rows on which ranges are compared, at most 20,000: those with the largest |x| in columns [first, first + count),
/// each for itself, as few of them decide whether a cut is seen, and others at even distances for all the rest.
std::vector<SampledRow> sample_rows(const GroupArrays<float>& group, int first, int count);

/// Where a range may end: of values in the order in which they would be cut off, those before which 0, 1, 2, 4, ...
/// lie, up to a quarter of them. `values` is not empty.
std::vector<float> possible_ends(const std::vector<float>& values);

}  // namespace gs
