// SPDX-License-Identifier: Apache-2.0
#include "kernels/blend/blend_cuda.h"

namespace gs {
namespace {

constexpr int kSubX = 8, kSubY = 4, kSubTiles = kCudaTilePixels / 32;

/// First pixel of sub-tile w (0..5) of a tile: two in a row, three rows. Pixels of a tile are numbered sub-tile by
/// sub-tile, so a warp owns 32 consecutive numbers and its checkpoints are one burst.
__device__ int2 sub_tile_origin(int tile, int tiles_x, int w) {
    return {tile % tiles_x * kCudaTileX + (w & 1) * kSubX, tile / tiles_x * kCudaTileY + (w >> 1) * kSubY};
}
__device__ int2 pixel_of(int2 origin, int lane) { return {origin.x + (lane & 7), origin.y + (lane >> 3)}; }

__device__ bool overlaps(const SplatBounds& b, int2 origin) {
    return b.x_min < origin.x + kSubX && b.x_max > origin.x && b.y_min < origin.y + kSubY && b.y_max > origin.y;
}

template <bool kForBackward>
__global__ void __launch_bounds__(kCudaTilePixels)
    blend_forward(CudaBins bins, const Splat<float>* __restrict__ splats, const SplatBounds* __restrict__ bounds, int width, int height, Vec3<float> background,
                  float* __restrict__ image, float* __restrict__ transmittance, float4* __restrict__ checkpoints, std::uint32_t* __restrict__ bucket_tiles,
                  std::uint32_t* __restrict__ last, std::uint32_t* __restrict__ max_last) {
    __shared__ Splat<float> batch[kCudaTilePixels];
    __shared__ SplatBounds batch_bounds[kCudaTilePixels];
    __shared__ unsigned tile_last;
    const int tile = blockIdx.x, warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const int2 origin = sub_tile_origin(tile, bins.tiles_x, warp), pixel = pixel_of(origin, lane);
    const bool inside = pixel.x < width && pixel.y < height;
    const std::uint32_t begin = bins.tile_offsets[tile], end = bins.tile_offsets[tile + 1];
    const std::uint32_t first_bucket = kForBackward ? bins.bucket_offsets[tile] : 0;
    if (kForBackward) {
        if (threadIdx.x == 0) tile_last = 0;
        for (std::uint32_t k = threadIdx.x; k < (end - begin + kBucket - 1) / kBucket; k += kCudaTilePixels) bucket_tiles[first_bucket + k] = tile;
    }
    PixelForward<float> p{inside ? 1.0f : 0.0f, 0, 0, 0};
    const float px = pixel.x + 0.5f, py = pixel.y + 0.5f;
    std::uint32_t contributor = 0;
    for (std::uint32_t base = begin; base < end; base += kCudaTilePixels) {
        if (__syncthreads_and(p.t < float(kMinTransmittance))) break;
        if (base + threadIdx.x < end) {
            const std::uint32_t g = bins.instances[base + threadIdx.x];
            batch[threadIdx.x] = splats[g];
            batch_bounds[threadIdx.x] = bounds[g];
        }
        __syncthreads();
        const int n = min(std::uint32_t(kCudaTilePixels), end - base);
        for (int group = 0; group < n; group += kBucket) {
            if (__all_sync(~0u, p.t < float(kMinTransmittance))) break;
            if (kForBackward)
                checkpoints[(std::size_t(first_bucket) + (base - begin + group) / kBucket) * kCudaTilePixels + threadIdx.x] = make_float4(p.r, p.g, p.b, p.t);
            unsigned hits = __ballot_sync(~0u, group + lane < n && overlaps(batch_bounds[group + lane], origin));
            for (; hits; hits &= hits - 1) {
                const int k = group + __ffs(hits) - 1;
                const Splat<float>& s = batch[k];
                const float alpha = fragment_alpha(FragmentShape<float>::from(s), px, py).alpha;
                if (alpha >= float(kMinAlpha) && p.t >= float(kMinTransmittance)) contributor = base - begin + k + 1;
                blend_fragment<float, float>(p, alpha, s.color.x, s.color.y, s.color.z);
            }
        }
    }
    if (inside) {
        const std::size_t i = std::size_t(pixel.y) * width + pixel.x, plane = std::size_t(width) * height;
        image[i] = p.r + p.t * background.x;
        image[i + plane] = p.g + p.t * background.y;
        image[i + 2 * plane] = p.b + p.t * background.z;
        transmittance[i] = p.t;
    }
    if (kForBackward) {
        last[std::size_t(tile) * kCudaTilePixels + threadIdx.x] = contributor;
        __syncthreads();
        const unsigned most = __reduce_max_sync(~0u, contributor);
        if (lane == 0) atomicMax(&tile_last, most);
        __syncthreads();
        if (threadIdx.x == 0) max_last[tile] = tile_last;
    }
}

/// What one pixel brings to the Gaussians of a bucket.
struct PixelState {
    float t, behind, gr, gg, gb, background;
};

constexpr int kBackwardWarps = 4;

__global__ void __launch_bounds__(32 * kBackwardWarps)
    blend_backward(CudaBins bins, std::uint32_t num_tiles, const Splat<float>* __restrict__ splats, const SplatBounds* __restrict__ bounds, int width, int height,
                   Vec3<float> background, const float* __restrict__ image, const float* __restrict__ transmittance, const float* __restrict__ dL_dimage,
                   const float4* __restrict__ checkpoints, const std::uint32_t* __restrict__ bucket_tiles, const std::uint32_t* __restrict__ last,
                   const std::uint32_t* __restrict__ max_last, PackedSums* __restrict__ sums) {
    __shared__ PixelState states[kBackwardWarps][32];
    __shared__ float2 centres[kBackwardWarps][32];
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const std::uint32_t bucket = blockIdx.x * kBackwardWarps + warp;
    if (bucket >= bins.bucket_offsets[num_tiles]) return;
    const std::uint32_t tile = bucket_tiles[bucket], first = (bucket - bins.bucket_offsets[tile]) * kBucket;
    if (first >= max_last[tile]) return;
    const std::uint32_t index = bins.tile_offsets[tile] + first + lane;
    const bool valid = index < bins.tile_offsets[tile + 1];
    const std::uint32_t gaussian = bins.instances[valid ? index : bins.tile_offsets[tile]];
    const Splat<float> s = splats[gaussian];
    const SplatBounds b = valid ? bounds[gaussian] : SplatBounds{0, 0, 0, 0};
    const FragmentShape<float> shape = FragmentShape<float>::from(s);
    const std::size_t plane = std::size_t(width) * height;

    SplatSums<float> sum{};
    PixelState state{};
    float px = 0, py = 0;
    const auto step = [&](bool fresh, int source) {
        // The pixel's state moves one lane up; lane 0 takes a fresh pixel, or nothing while the pipeline drains.
        state.t = __shfl_up_sync(~0u, state.t, 1);
        state.behind = __shfl_up_sync(~0u, state.behind, 1);
        state.gr = __shfl_up_sync(~0u, state.gr, 1);
        state.gg = __shfl_up_sync(~0u, state.gg, 1);
        state.gb = __shfl_up_sync(~0u, state.gb, 1);
        state.background = __shfl_up_sync(~0u, state.background, 1);
        px = __shfl_up_sync(~0u, px, 1);
        py = __shfl_up_sync(~0u, py, 1);
        if (lane == 0) {
            state = fresh ? states[warp][source] : PixelState{};
            px = centres[warp][source].x, py = centres[warp][source].y;
        }
        if (valid && state.t >= float(kMinTransmittance)) {
            const FragmentAlpha<float> f = fragment_alpha(shape, px, py);
            if (f.alpha >= float(kMinAlpha)) {
                PixelBackward<float> p{state.t, state.behind, state.gr, state.gg, state.gb, state.background};
                blend_fragment_backward<float, float>(p, f, s.color.x, s.color.y, s.color.z, sum);
                state.t = p.t, state.behind = p.behind;
            }
        }
    };
    bool any = false;
    for (int w = 0; w < kSubTiles; ++w) {
        // A sub-tile none of the 32 Gaussians reaches is skipped: its pixels would pass through unchanged.
        const int2 origin = sub_tile_origin(tile, bins.tiles_x, w), pixel = pixel_of(origin, lane);
        if (!__any_sync(~0u, overlaps(b, origin))) continue;
        const std::uint32_t number = w * 32 + lane;
        const bool inside = pixel.x < width && pixel.y < height;
        const bool alive = inside && last[std::size_t(tile) * kCudaTilePixels + number] > first; // finished pixels have no checkpoint
        if (!__any_sync(~0u, alive)) continue;
        PixelState fresh{};
        if (alive) {
            const std::size_t i = std::size_t(pixel.y) * width + pixel.x;
            const float4 c = checkpoints[std::size_t(bucket) * kCudaTilePixels + number];
            fresh.t = c.w;
            fresh.gr = dL_dimage[i], fresh.gg = dL_dimage[i + plane], fresh.gb = dL_dimage[i + 2 * plane];
            const float t_final = transmittance[i];
            fresh.background = t_final * (fresh.gr * background.x + fresh.gg * background.y + fresh.gb * background.z);
            fresh.behind = (image[i] - t_final * background.x - c.x) * fresh.gr + (image[i + plane] - t_final * background.y - c.y) * fresh.gg +
                           (image[i + 2 * plane] - t_final * background.z - c.z) * fresh.gb;
        }
        __syncwarp();
        states[warp][lane] = fresh;
        centres[warp][lane] = make_float2(pixel.x + 0.5f, pixel.y + 0.5f);
        __syncwarp();
        for (int k = 0; k < 32; ++k) step(true, k);
        any = true;
    }
    if (!any) return;
    for (int k = 0; k < 31; ++k) step(false, 0);
    if (valid) {
        PackedSums* out = sums + gaussian;
        atomicAdd(&out->a, make_float4(sum.h, sum.hx, sum.hy, sum.hxx));
        atomicAdd(&out->b, make_float4(sum.hxy, sum.hyy, sum.r, sum.g));
        atomicAdd(&out->c.x, sum.b);
    }
}

}  // namespace

void CudaBlend::forward(const CudaBins& bins, const Splat<float>* splats, const SplatBounds* bounds, int width, int height, Vec3<float> background, float* image,
                        float* transmittance, bool for_backward, cudaStream_t stream) {
    const std::size_t tiles = std::size_t(bins.tiles_x) * bins.tiles_y;
    if (for_backward) {
        checkpoints_.reserve(std::size_t(bins.max_buckets) * kCudaTilePixels);
        bucket_tiles_.reserve(bins.max_buckets);
        last_.reserve(tiles * kCudaTilePixels);
        max_last_.reserve(tiles);
        blend_forward<true><<<unsigned(tiles), kCudaTilePixels, 0, stream>>>(bins, splats, bounds, width, height, background, image, transmittance,
                                                                             checkpoints_.get(), bucket_tiles_.get(), last_.get(), max_last_.get());
    } else {
        blend_forward<false><<<unsigned(tiles), kCudaTilePixels, 0, stream>>>(bins, splats, bounds, width, height, background, image, transmittance, nullptr,
                                                                              nullptr, nullptr, nullptr);
    }
    GS_CUDA_LAUNCHED("blend_forward");
}

void CudaBlend::backward(const CudaBins& bins, const Splat<float>* splats, const SplatBounds* bounds, int width, int height, Vec3<float> background,
                         const float* image, const float* transmittance, const float* dL_dimage, PackedSums* sums, cudaStream_t stream) {
    const std::uint32_t tiles = std::uint32_t(bins.tiles_x) * bins.tiles_y;
    if (bins.num_instances == 0) return;
    blend_backward<<<num_blocks(bins.max_buckets, kBackwardWarps), 32 * kBackwardWarps, 0, stream>>>(
        bins, tiles, splats, bounds, width, height, background, image, transmittance, dL_dimage, checkpoints_.get(), bucket_tiles_.get(), last_.get(),
        max_last_.get(), sums);
    GS_CUDA_LAUNCHED("blend_backward");
}

}  // namespace gs
