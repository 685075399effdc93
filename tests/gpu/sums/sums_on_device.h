// SPDX-License-Identifier: Apache-2.0
// kernels/optimizer/sum_rows_cuda.h for host code.
#pragma once

#include <cstdint>
#include <vector>

namespace gs::test {

/// Returns the sum of those rows of `values` (rows, width) that are set.
std::vector<float> sum_on_device(const std::vector<float>& values, const std::vector<std::uint8_t>& is_set, int width);

}  // namespace gs::test
