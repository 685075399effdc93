// SPDX-License-Identifier: Apache-2.0
// Steps on gradients that were added up before. They know no appearance model.
#include "kernels/optimizer/moments_cuda.cuh"
#include "kernels/optimizer/step_rows_cuda.h"

namespace gs {
namespace {

constexpr int kStepBlock = 128, kSumBlock = 256;

__global__ void __launch_bounds__(kStepBlock)
    step_gaussians(ModelArrays arrays, UpdateArgs update, std::int64_t n, const GaussianGradient<float>* gradients) {
    const std::int64_t i = std::int64_t(blockIdx.x) * kStepBlock + threadIdx.x;
    if (i >= n) return;
    GaussianGradient<float> gradient = gradients[i];
    update_gaussian(arrays, update, i, gradient);
}

__global__ void __launch_bounds__(kStepBlock)
    step_residuals(ModelArrays arrays, UpdateArgs update, std::int64_t num_values, const float* gradients,
                   std::uint32_t seed) {
    constexpr int k = int(Group::kResidual);
    const std::int64_t i = std::int64_t(blockIdx.x) * kStepBlock + threadIdx.x;
    if (i >= num_values) return;
    const MomentRows moments = MomentRows{arrays.m[k], arrays.v[k]}.at(i);
    float p = arrays.param[k][i], m, v;
    moments.load(0, m, v);
    moments.unpack(m, v);
    adam_update(p, m, v, gradients[i], update.per_column ? update.residual_steps[i % arrays.width[k]] : update.steps[k],
                update.gains);
    arrays.param[k][i] = p;
    moments.store(0, m, v, mix_bits(std::uint32_t(i) ^ seed));
}

__global__ void __launch_bounds__(kSumBlock)
    sum_column(const float* __restrict__ in, std::int64_t rows, int width, float share, float* __restrict__ out) {
    __shared__ float partial[kSumBlock];
    float sum = 0;
    for (std::int64_t row = threadIdx.x; row < rows; row += kSumBlock) sum += in[row * width + blockIdx.x];
    partial[threadIdx.x] = sum;
    for (int half = kSumBlock / 2; half > 0; half /= 2) {
        __syncthreads();
        if (int(threadIdx.x) < half) partial[threadIdx.x] += partial[threadIdx.x + half];
    }
    if (threadIdx.x == 0) out[blockIdx.x] += share * partial[0];
}

}  // namespace

void step_rows(const ModelArrays& arrays, std::int64_t n, std::int64_t num_residuals, const UpdateArgs& update,
               const StepGradients& gradients, std::int64_t t, cudaStream_t stream) {
    if (n == 0) return;
    step_gaussians<<<num_blocks(n, kStepBlock), kStepBlock, 0, stream>>>(arrays, update, n, gradients.gaussians);
    GS_CUDA_LAUNCHED("step_gaussians");
    const std::int64_t num_values = num_residuals * arrays.width[int(Group::kResidual)];
    if (num_values == 0) return;
    step_residuals<<<num_blocks(num_values, kStepBlock), kStepBlock, 0, stream>>>(
        arrays, update, num_values, gradients.residuals, mix_bits(std::uint32_t(t)));
    GS_CUDA_LAUNCHED("step_residuals");
}

void add_sum_of_rows(const float* in, std::int64_t rows, int width, float share, float* out, cudaStream_t stream) {
    if (width == 0) return;
    sum_column<<<width, kSumBlock, 0, stream>>>(in, rows, width, share, out);
    GS_CUDA_LAUNCHED("sum_column");
}

}  // namespace gs
