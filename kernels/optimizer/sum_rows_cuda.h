// SPDX-License-Identifier: Apache-2.0
// The sum of many rows, on the device. Only .cu files include this header.
#pragma once

#include <cstdint>

#include "kernels/cuda/cuda.h"

namespace gs {

/// Writes the sum of `rows` rows to `out` (width). Adds in a fixed order.
void sum_rows(const float* in, std::int64_t rows, int width, float* out, cudaStream_t stream);

}  // namespace gs
