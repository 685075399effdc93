// SPDX-License-Identifier: Apache-2.0
// Gathers what residuals are worth, on the device.
#include "kernels/blend/residual_scores_cuda.h"

namespace gs {
namespace {

constexpr int kScoreBlock = 128;

__device__ std::int64_t score_row() { return std::int64_t(blockIdx.x) * kScoreBlock + threadIdx.x; }

__device__ Vec3<float> color_part(const PackedSums& s) { return {s.b.z, s.b.w, s.c.x}; }

__device__ Vec3<float> base_shown(const ParameterView<float>& params, std::int64_t i) {
    const Vec3<float> y = params.base(i);
    return {color_activation(params.activation, y.x), color_activation(params.activation, y.y),
            color_activation(params.activation, y.z)};
}

__global__ void keep_color_gradients(std::int64_t n, const std::uint32_t* counts, const PackedSums* sums,
                                     Vec3<float>* out) {
    const std::int64_t i = score_row();
    if (i < n && counts[i] > 0) out[i] = color_part(sums[i]);
}

__global__ void add_view(ParameterView<float> params, const std::uint32_t* counts, const PackedSplat* splats,
                         const PackedSums* view, const Vec3<float>* gradients, ResidualSums* sums) {
    const std::int64_t i = score_row();
    if (i >= params.num_residuals || counts[i] == 0) return;
    const float weight = color_part(view[i]).x;
    if (weight > 0) sums[i].add(weight, gradients[i], splats[i].splat().color, base_shown(params, i));
}

__global__ void write_scores(ParameterView<float> params, const ResidualSums* sums, float* worth, float* mean_base) {
    const std::int64_t i = score_row();
    if (i >= params.count) return;
    Vec3<float> base = params.base(i);
    worth[i] = 0;
    if (i < params.num_residuals) worth[i] = sums[i].worth(), base = sums[i].mean_base(params.activation, base);
    mean_base[3 * i] = base.x, mean_base[3 * i + 1] = base.y, mean_base[3 * i + 2] = base.z;
}

}  // namespace

CudaResidualScores::CudaResidualScores(std::int64_t num_residuals, cudaStream_t stream)
    : num_residuals_(num_residuals), stream_(stream) {
    if (num_residuals == 0) return;
    gradients_.reserve(num_residuals);
    GS_CUDA(cudaMemsetAsync(sums_.reserve(num_residuals), 0, num_residuals * sizeof(ResidualSums), stream));
}

void CudaResidualScores::keep_gradients(const std::uint32_t* counts, const PackedSums* sums) {
    if (num_residuals_ == 0) return;
    keep_color_gradients<<<num_blocks(num_residuals_, kScoreBlock), kScoreBlock, 0, stream_>>>(num_residuals_, counts,
                                                                                               sums, gradients_.get());
    GS_CUDA_LAUNCHED("keep_color_gradients");
}

void CudaResidualScores::add(const ParameterView<float>& params, const std::uint32_t* counts, const PackedSplat* splats,
                             const PackedSums* sums) {
    if (num_residuals_ == 0) return;
    add_view<<<num_blocks(num_residuals_, kScoreBlock), kScoreBlock, 0, stream_>>>(params, counts, splats, sums,
                                                                                   gradients_.get(), sums_.get());
    GS_CUDA_LAUNCHED("add_view");
}

ResidualScores CudaResidualScores::download(const ParameterView<float>& params) {
    ResidualScores out;
    if (const std::int64_t n = params.count; n > 0) {
        DeviceBuffer<float> worth, mean_base;
        write_scores<<<num_blocks(n, kScoreBlock), kScoreBlock, 0, stream_>>>(params, sums_.get(), worth.reserve(n),
                                                                              mean_base.reserve(3 * n));
        GS_CUDA_LAUNCHED("write_scores");
        GS_CUDA(cudaStreamSynchronize(stream_));
        out.worth = worth.download(n), out.mean_base = mean_base.download(3 * n);
    }
    return out;
}

}  // namespace gs
