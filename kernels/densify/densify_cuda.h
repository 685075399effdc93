// SPDX-License-Identifier: Apache-2.0
// Grows, relocates, prunes and orders rows on the device, with the same decisions as densify.h.
#pragma once

#include "kernels/cuda/model_cuda.h"
#include "kernels/requests.h"

namespace gs {

/// Densifies `model`. Every call works on `stream`, and is complete when it returns. It may use all of `scratch`.
class CudaDensify {
  public:
    CudaDensify(CudaModel& model, Scratch& scratch, cudaStream_t stream)
        : model_(model), scratch_(scratch), stream_(stream) {}

    /// Relocates and grows by MCMC. `step` is Adam's step, as in CudaModel::last_step.
    DensifyStats mcmc(const McmcParams& params, std::int64_t iteration, std::int64_t step, std::uint64_t seed);
    DensifyStats adc(const AdcParams& params, std::int64_t iteration, std::uint64_t seed);
    void reset_opacity();
    void morton_sort();
    /// Removes the rows that are not in `rows` (ascending).
    void keep_rows(const std::vector<std::uint32_t>& rows);
    std::int64_t prune_nonfinite(std::int64_t by_group[kNumGroups]);
    std::int64_t prune_invisible();

  private:
    CudaModel& model_;
    Scratch& scratch_;
    cudaStream_t stream_;
};

}  // namespace gs
