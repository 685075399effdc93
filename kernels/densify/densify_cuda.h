// SPDX-License-Identifier: Apache-2.0
// Applies a densification plan to rows on the device.
#pragma once

#include "kernels/core/cuda.h"
#include "kernels/densify/mcmc_plan.h"
#include "kernels/optimizer/update_device.h"

namespace gs {

/// usable[i] = 0 where the rotation of row i is degenerate.
void find_usable(std::int64_t n, const float* rotations, char* usable, cudaStream_t stream);

/// Buffers are reused from call to call.
class CudaMcmc {
  public:
    /// Rows named by the round must exist in `arrays`.
    void apply(const McmcRound& round, const ModelArrays& arrays, cudaStream_t stream);

  private:
    DeviceBuffer<std::uint32_t> sources_, to_, from_;
    DeviceBuffer<float> raw_opacity_, shift_;
};

}  // namespace gs
