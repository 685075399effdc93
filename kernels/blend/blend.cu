// SPDX-License-Identifier: Apache-2.0
#include "kernels/blend/sub_tile_cuda.h"

namespace gs {
namespace {

/// Six bits: which sub-tiles of the tile at (x0, y0) a splat reaches.
__device__ unsigned reached_sub_tiles(const Splat<float>& s, int x0, int y0) {
    const float threshold = touch_threshold(s);
    unsigned mask = 0;
#pragma unroll
    for (int w = 0; w < kSubTiles; ++w) {
        const float power = min_power_in_rectangle(s, float(x0 + (w & 1) * kSubX), float(y0 + (w >> 1) * kSubY), float(kSubX - 1), float(kSubY - 1));
        mask |= unsigned(power <= threshold) << w;
    }
    return mask;
}

template <bool kForBackward>
__global__ void __launch_bounds__(kCudaTilePixels)
    blend_forward(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image, StepControl* __restrict__ control, float4* __restrict__ checkpoints,
                  BlendChunk* __restrict__ chunks, std::uint8_t* __restrict__ sub_tiles) {
    __shared__ SplatBatch batch;
    __shared__ std::uint8_t reached[kChunk];
    __shared__ unsigned first_checkpoint, num_pairs;
    const int tile = blockIdx.x, warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const int2 corner = tile_corner(tile, bins.tiles_x), pixel = pixel_of(corner, warp, lane);
    const bool inside = pixel.x < image.width && pixel.y < image.height;
    const std::uint32_t begin = bins.tile_offsets[tile], end = bins.tile_offsets[tile + 1];
    if (kForBackward && threadIdx.x == 0) {
        num_pairs = 0;
        if (end - begin > kChunk) first_checkpoint = atomicAdd(&control->num_checkpoints, (end - begin - 1) / kChunk);
    }
    PixelForward<float> p{inside ? 1.0f : 0.0f, 0, 0, 0};
    const float px = pixel.x + 0.5f, py = pixel.y + 0.5f;
    unsigned pairs = 0;
    std::uint32_t base = begin;
    // The next chunk's splat is on its way while this one is blended.
    const auto fetch = [&](std::uint32_t at) {
        std::uint32_t g = bins.instances[at];
        if (bins.gaussians) g = bins.gaussians[g];
        return splats[g];
    };
    PackedSplat next{};
    if (begin + threadIdx.x < end) next = fetch(begin + threadIdx.x);
    for (; base < end; base += kChunk) {
        if (__syncthreads_and(p.t < float(kMinTransmittance))) break;
        if (kForBackward && base > begin)
            checkpoints[(std::size_t(first_checkpoint) + (base - begin) / kChunk - 1) * kCudaTilePixels + threadIdx.x] = make_float4(p.r, p.g, p.b, p.t);
        if (base + threadIdx.x < end) {
            const Splat<float> s = next.splat();
            batch.store(threadIdx.x, s);
            const unsigned mask = reached_sub_tiles(s, corner.x, corner.y);
            reached[threadIdx.x] = mask;
            if (kForBackward) sub_tiles[base + threadIdx.x] = mask;
        }
        if (base + kChunk + threadIdx.x < end) next = fetch(base + kChunk + threadIdx.x);
        __syncthreads();
        const int n = min(std::uint32_t(kChunk), end - base);
        for (int group = 0; group < n; group += 32) {
            if (__all_sync(~0u, p.t < float(kMinTransmittance))) break;
            unsigned hits = __ballot_sync(~0u, group + lane < n && (reached[group + lane] >> warp & 1));
            pairs += __popc(hits);
            for (; hits; hits &= hits - 1) {
                const int k = group + __ffs(hits) - 1;
                const auto s = batch.load(k);
                blend_fragment<float, float>(p, fragment_alpha(s.shape, px, py).alpha, s.r, s.g, s.b);
            }
        }
    }
    if (inside) {
        const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x, plane = std::size_t(image.width) * image.height;
        image.rgb[i] = p.r + p.t * image.background.x;
        image.rgb[i + plane] = p.g + p.t * image.background.y;
        image.rgb[i + 2 * plane] = p.b + p.t * image.background.z;
        image.transmittance[i] = p.t;
    }
    if (kForBackward) {
        if (lane == 0 && pairs) atomicAdd(&num_pairs, pairs);
        __syncthreads();
        const std::uint32_t begun = min((base - begin) / kChunk, (end - begin + kChunk - 1) / kChunk);
        __shared__ unsigned first_chunk;
        if (threadIdx.x == 0 && begun) {
            first_chunk = atomicAdd(&control->num_chunks, begun);
            atomicAdd(&control->num_pairs, (unsigned long long)num_pairs);
        }
        __syncthreads();
        for (std::uint32_t k = threadIdx.x; k < begun; k += kCudaTilePixels)
            chunks[first_chunk + k] = {std::uint32_t(tile), k * kChunk, k ? first_checkpoint + k - 1 : 0};
    }
}

}  // namespace

void CudaBlend::take(Carver& c, std::int64_t capacity, int num_tiles) {
    capacity_ = capacity;
    // A list of n instances has ceil(n / kChunk) chunks, and one checkpoint less.
    checkpoints_ = c.take<float4>(std::size_t(capacity / kChunk) * kCudaTilePixels);
    chunks_ = c.take<BlendChunk>(capacity / kChunk + num_tiles);
    sub_tiles_ = c.take<std::uint8_t>(capacity);
}

void CudaBlend::forward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, StepControl* control, bool for_backward, cudaStream_t stream) {
    if (for_backward)
        blend_forward<true><<<bins.num_tiles(), kCudaTilePixels, 0, stream>>>(bins, splats, image, control, checkpoints_, chunks_, sub_tiles_);
    else
        blend_forward<false><<<bins.num_tiles(), kCudaTilePixels, 0, stream>>>(bins, splats, image, control, nullptr, nullptr, nullptr);
    GS_CUDA_LAUNCHED("blend_forward");
}

}  // namespace gs
