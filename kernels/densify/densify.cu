// SPDX-License-Identifier: Apache-2.0
#include "kernels/densify/densify_cuda.h"

namespace gs {
namespace {

constexpr int kBlock = 256;

__global__ void usable_rotations(std::int64_t n, const float* rotations, char* usable) {
    const std::int64_t i = std::int64_t(blockIdx.x) * kBlock + threadIdx.x;
    if (i >= n) return;
    const float* q = rotations + 4 * i;
    usable[i] = norm2(Vec4<float>{q[0], q[1], q[2], q[3]}) >= float(kMinQuaternionNorm2);
}

__global__ void share_sources(std::uint32_t n, const std::uint32_t* sources, const float* raw_opacity, const float* shift, ModelArrays a) {
    const std::uint32_t k = blockIdx.x * kBlock + threadIdx.x;
    if (k >= n) return;
    const std::size_t j = sources[k];
    a.param[int(Group::kOpacity)][j] = raw_opacity[k];
    for (int c = 0; c < 3; ++c) a.param[int(Group::kScale)][3 * j + c] += shift[k];
    for (int g = 0; g < kNumGroups; ++g)
        for (int c = 0; c < a.width[g]; ++c) a.m[g][j * a.width[g] + c] = a.v[g][j * a.width[g] + c] = 0.0f;
}

__global__ void copy_rows(std::uint32_t n, int width, const std::uint32_t* to, const std::uint32_t* from, float* data) {
    const std::size_t k = std::size_t(blockIdx.x) * kBlock + threadIdx.x;
    if (k < std::size_t(n) * width) data[std::size_t(to[k / width]) * width + k % width] = data[std::size_t(from[k / width]) * width + k % width];
}

}  // namespace

void find_usable(std::int64_t n, const float* rotations, char* usable, cudaStream_t stream) {
    if (n == 0) return;
    usable_rotations<<<num_blocks(n, kBlock), kBlock, 0, stream>>>(n, rotations, usable);
    GS_CUDA_LAUNCHED("usable_rotations");
}

void CudaMcmc::apply(const McmcRound& round, const ModelArrays& arrays, cudaStream_t stream) {
    if (!round.sources.empty()) {
        sources_.upload(round.sources, stream), raw_opacity_.upload(round.raw_opacity, stream), shift_.upload(round.log_scale_shift, stream);
        const auto n = std::uint32_t(round.sources.size());
        share_sources<<<num_blocks(n, kBlock), kBlock, 0, stream>>>(n, sources_.get(), raw_opacity_.get(), shift_.get(), arrays);
        GS_CUDA_LAUNCHED("share_sources");
    }
    if (!round.to.empty()) {
        to_.upload(round.to, stream), from_.upload(round.from, stream);
        const auto n = std::uint32_t(round.to.size());
        for (int g = 0; g < kNumGroups; ++g) {
            if (arrays.width[g] == 0) continue;
            copy_rows<<<num_blocks(std::int64_t(n) * arrays.width[g], kBlock), kBlock, 0, stream>>>(n, arrays.width[g], to_.get(), from_.get(), arrays.param[g]);
            GS_CUDA_LAUNCHED("copy_rows");
        }
    }
}

}  // namespace gs
