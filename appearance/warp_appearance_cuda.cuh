// SPDX-License-Identifier: Apache-2.0
// How a warp evaluates an appearance model for the 32 Gaussians of its lanes.
#pragma once

#include "appearance/contract.h"

namespace gs {

/// By default each lane evaluates its own Gaussian. A model whose lanes work together specializes this in its folder
/// (`<folder>_cuda.cuh`); with shared weights it must, and has the members that are named at the end.
///
/// All lanes of a warp call every function together; `active` says whether a lane has a Gaussian. Rows are in shared memory,
/// `width` floats for each lane; inactive rows hold anything.
template <class Model> class WarpAppearance {
    static_assert(kNumSharedOf<Model> == 0, "a model with shared weights says itself how a warp evaluates it");

  public:
    /// Shared memory of a warp.
    struct Memory {};

    __device__ WarpAppearance(Memory&, const unsigned*) {}

    __device__ Vec3<float> residual(const float* rows, int width, const Vec3<float>& direction, int degree, bool active) const {
        if (!active) return {0, 0, 0};
        return model_residual<Model>(static_cast<const float*>(nullptr), rows + lane() * width, direction, degree);
    }
    /// After residual() with the same arguments. `gradients`: zeroed rows.
    __device__ void backward(const float* rows, int width, const Vec3<float>& direction, int degree, bool active, const Vec3<float>& dL_dresidual, float* gradients,
                             Vec3<float>& dL_ddirection) const {
        dL_ddirection = {0, 0, 0};
        if (active)
            model_residual_backward<Model>(static_cast<const float*>(nullptr), rows + lane() * width, direction, degree, dL_dresidual, gradients + lane() * width, dL_ddirection,
                                           static_cast<float*>(nullptr));
    }
    // With shared weights also:
    //   static constexpr int kPreparedWords            size of what the kernels read of the weights, 4-byte words
    //   static void prepare(unsigned*, int k, float w) writes weight k there; the rest of it is 0
    //   void store_sums(float* sums) const             writes this warp's gradient of the weights, if backward() ran

  private:
    static __device__ int lane() { return threadIdx.x & 31; }
};

}  // namespace gs
