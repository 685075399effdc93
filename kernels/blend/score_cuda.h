// SPDX-License-Identifier: Apache-2.0
// Scores of all Gaussians on the device, gathered view by view (docs/math/densification.md#pruning-by-score).
#pragma once

#include <vector>

#include "kernels/blend/blend_cuda.h"

namespace gs {

/// Holds 4 bytes a Gaussian while it lives, with a fixed order of sums also 24 bytes an instance.
class CudaScores {
  public:
    /// All zero.
    CudaScores(std::int64_t n, cudaStream_t stream);

    /// Adds a view that was blended into `image`. Float atomics: the order of additions varies from run to run. With `slots`,
    /// of `num_instances`, they have a fixed order.
    void add(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, const SlotMap* slots, std::int64_t num_instances);

    const float* get() const { return scores_.get(); }
    /// Waits.
    std::vector<float> download() const;

  private:
    std::int64_t n_;
    cudaStream_t stream_;
    DeviceBuffer<float> scores_;
    DeviceBuffer<float> partial_; ///< (slots, sub-tiles)
};

}  // namespace gs
