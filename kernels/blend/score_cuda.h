// SPDX-License-Identifier: Apache-2.0
// The scores of all Gaussians on the device, gathered view by view (docs/math/densification.md#pruning-by-score).
#pragma once

#include <vector>

#include "kernels/blend/blend_cuda.h"

namespace gs {

/// The scores of n Gaussians. It holds 4 bytes a Gaussian while it lives, and 24 bytes an instance more with a fixed
/// order of sums.
class CudaScores {
  public:
    /// Starts with scores of zero.
    CudaScores(std::int64_t n, cudaStream_t stream);

    /// Adds a view that was blended into `image`. It uses float atomics, whose order varies from run to run. With
    /// `slots`, which belong to `num_instances`, the order is fixed.
    void add(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, const SlotMap* slots,
             std::int64_t num_instances);

    /// Waits for the stream and returns the scores (n).
    std::vector<float> download() const;

  private:
    std::int64_t n_;
    cudaStream_t stream_;
    DeviceBuffer<float> scores_;
    DeviceBuffer<float> partial_;  ///< (slots, sub-tiles)
};

}  // namespace gs
