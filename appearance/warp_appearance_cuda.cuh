// SPDX-License-Identifier: Apache-2.0
// Evaluates an appearance model in a warp, for the 32 Gaussians of its lanes.
#pragma once

#include "appearance/contract.h"

namespace gs {

/// Evaluates a model for the Gaussians of a warp. By default each lane evaluates its own Gaussian. A model whose lanes
/// work together specializes this class in its folder (`<folder>_cuda.cuh`). A model with shared weights must do so and
/// adds the members listed at the end.
///
/// All lanes of a warp call every function together; `active` is true if the lane has a Gaussian. Rows are in shared
/// memory, `width` floats per lane. Rows of inactive lanes may hold any values.
template <class Model> class WarpAppearance {
    static_assert(kNumSharedOf<Model> == 0, "a model with shared weights says itself how a warp evaluates it");

  public:
    /// The shared memory of a warp.
    struct Memory {};

    __device__ WarpAppearance(Memory&, const unsigned*) {}

    __device__ Vec3<float> residual(const float* rows, int width, const Vec3<float>& direction, int degree,
                                    bool active) const {
        if (!active) return {0, 0, 0};
        return model_residual<Model>(static_cast<const float*>(nullptr), rows + lane() * width, direction, degree);
    }
    /// Computes the gradients. Call it after residual() with the same arguments. With kAdds it adds to the rows of
    /// `gradients`; otherwise these rows must be zeroed.
    template <bool kAdds = false>
    __device__ void backward(const float* rows, int width, const Vec3<float>& direction, int degree, bool active,
                             const Vec3<float>& dL_dresidual, float* gradients, Vec3<float>& dL_ddirection) const {
        dL_ddirection = {0, 0, 0};
        if (!active) return;
        float* const own = gradients + lane() * width;
        const auto compute = [&](float* to) {
            model_residual_backward<Model>(static_cast<const float*>(nullptr), rows + lane() * width, direction, degree,
                                           dL_dresidual, to, dL_ddirection, static_cast<float*>(nullptr));
        };
        if constexpr (kAdds && Model::kMaxResidual > 0) {
            float one[Model::kMaxResidual] = {};
            compute(one);
#pragma unroll
            for (int k = 0; k < Model::kMaxResidual; ++k)
                if (k < width) own[k] += one[k];
        } else {
            compute(own);
        }
    }
    // A model with shared weights also has:
    //   static constexpr int kPreparedWords            size of the weights as kernels read them, in 4-byte words
    //   static void prepare(unsigned*, int k, float w) writes weight k in that form; all other words are 0
    //   void store_sums(float* sums) const             writes this warp's gradient of the weights, if backward() ran

  private:
    static __device__ int lane() { return threadIdx.x & 31; }
};

}  // namespace gs
