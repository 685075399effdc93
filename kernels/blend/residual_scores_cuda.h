// SPDX-License-Identifier: Apache-2.0
// What residuals are worth, gathered view by view on the device (residual_score.h).
#pragma once

#include "kernels/blend/blend_cuda.h"
#include "kernels/blend/residual_score.h"
#include "kernels/cuda/device_memory.h"
#include "kernels/requests.h"
#include "kernels/splat/gaussian_rows_device.h"

namespace gs {

/// The sums of the Gaussians of a model that have a residual.
class CudaResidualScores {
  public:
    /// Returns what an object takes while it lives.
    static std::int64_t bytes(std::int64_t num_residuals) {
        return num_residuals * std::int64_t(sizeof(Vec3<float>) + sizeof(ResidualSums));
    }
    CudaResidualScores(std::int64_t num_residuals, cudaStream_t stream);

    /// Keeps the gradients by the colours, from the backward pass of a view's error. `counts` of 0: out of view.
    void keep_gradients(const std::uint32_t* counts, const PackedSums* sums);
    /// Adds the view, with the sums of the backward pass of its weights.
    void add(const ParameterView<float>& params, const std::uint32_t* counts, const PackedSplat* splats,
             const PackedSums* sums);
    /// Waits for the stream and returns the sums.
    std::vector<ResidualSums> download() const;

  private:
    std::int64_t num_residuals_;
    cudaStream_t stream_;
    DeviceBuffer<Vec3<float>> gradients_;
    DeviceBuffer<ResidualSums> sums_;
};

}  // namespace gs
