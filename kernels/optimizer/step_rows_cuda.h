// SPDX-License-Identifier: Apache-2.0
// The optimizer's step on the mean gradient of several views, on the device. Only .cu files include this header.
#pragma once

#include "kernels/cuda/cuda.h"
#include "kernels/optimizer/update_device.h"

namespace gs {

/// The mean gradients of a step on several views.
struct StepGradients {
    GaussianGradient<float>* gaussians;  ///< (n)
    float* residuals;                    ///< (rows with a residual, width)
};

/// Takes the step of all Gaussians and of the first `num_residuals` residuals. `t` is Adam's step.
void step_rows(const ModelArrays& arrays, std::int64_t n, std::int64_t num_residuals, const UpdateArgs& update,
               const StepGradients& gradients, std::int64_t t, cudaStream_t stream);

/// Adds a share of the sum of `rows` rows to `out` (width), in a fixed order.
void add_sum_of_rows(const float* in, std::int64_t rows, int width, float share, float* out, cudaStream_t stream);

}  // namespace gs
