// SPDX-License-Identifier: Apache-2.0
// Gathers the values of residuals on the device.
#include "kernels/blend/blend_cuda.h"

namespace gs {
namespace {

constexpr int kScoreBlock = 128;

__device__ std::int64_t score_row() { return std::int64_t(blockIdx.x) * kScoreBlock + threadIdx.x; }

__device__ Vec3<float> color_part(const PackedSums& s) { return {s.b.z, s.b.w, s.c.x}; }

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
    if (weight > 0)
        sums[i].add(weight, gradients[i], splats[i].splat().color, activate(params.activation, params.base(i)));
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

std::vector<ResidualSums> CudaResidualScores::download() const {
    GS_CUDA(cudaStreamSynchronize(stream_));
    return sums_.download(num_residuals_);
}

}  // namespace gs
