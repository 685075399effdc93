// SPDX-License-Identifier: Apache-2.0
// The forward pass: a warp per sub-tile blends the list of its tile.
#include "kernels/blend/sub_tile_cuda.h"

namespace gs {
namespace {

constexpr int kAtOnce = 4;

/// What the warps of a block find out together about their tile's list.
struct TileRecord {
    unsigned first_checkpoint, first_chunk, num_chunks, num_pairs;
};

__device__ void write_pixel(const BlendImage& image, int2 pixel, const PixelForward<float>& p) {
    const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x, plane = std::size_t(image.width) * image.height;
    image.rgb[i] = p.r + p.t * image.background.x;
    image.rgb[i + plane] = p.g + p.t * image.background.y;
    image.rgb[i + 2 * plane] = p.b + p.t * image.background.z;
    image.transmittance[i] = p.t;
}

/// Lists the chunks of a tile for the backward pass. `processed`: instances that this warp went through; `pairs`: hits
/// among them. All threads of the block take part.
__device__ void list_chunks(TileRecord& record, int tile, unsigned processed, unsigned pairs, const BlendTrail& trail,
                            StepControl* control) {
    if ((threadIdx.x & 31) == 0) {
        trail.processed[tile * kSubTiles + (threadIdx.x >> 5)] = processed;
        atomicAdd(&record.num_pairs, pairs);
        atomicMax(&record.num_chunks, (processed + kChunk - 1) / kChunk);
    }
    __syncthreads();
    if (threadIdx.x == 0 && record.num_chunks) {
        record.first_chunk = atomicAdd(&control->num_chunks, record.num_chunks);
        atomicAdd(&control->num_pairs, (unsigned long long)record.num_pairs);
    }
    __syncthreads();
    for (std::uint32_t k = threadIdx.x; k < record.num_chunks; k += kCudaTilePixels)
        trail.chunks[record.first_chunk + k] = {std::uint32_t(tile), k * kChunk,
                                                k ? record.first_checkpoint + k - 1 : 0};
}

template <bool kForBackward>
__global__ void __launch_bounds__(kCudaTilePixels, 6)
    blend_forward(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image,
                  StepControl* __restrict__ control, BlendTrail trail) {
    __shared__ SplatBatch batches[kSubTiles];
    __shared__ TileRecord record;
    const int tile = bins.longest_first[blockIdx.x], warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const int2 sub_tile = sub_tile_corner(tile_corner(tile, bins.tiles_x), warp), pixel = pixel_of(sub_tile, lane);
    const bool inside = pixel.x < image.width && pixel.y < image.height;
    const std::uint32_t begin = bins.tile_offsets[tile], end = bins.tile_offsets[tile + 1];
    if (kForBackward) {
        if (threadIdx.x == 0) {
            record.num_chunks = record.num_pairs = 0;
            if (end - begin > kChunk)
                record.first_checkpoint = atomicAdd(&control->num_checkpoints, (end - begin - 1) / kChunk);
        }
        __syncthreads();
    }
    // From here on each warp of a block walks the whole list on its own, 32 instances at a time.
    SplatBatch& batch = batches[warp];
    std::uint32_t* hits_out = trail.hits + (first_group(tile, begin) * kSubTiles + warp);
    PixelForward<float> p{inside ? 1.0f : 0.0f, 0, 0, 0};
    const float px = pixel.x + 0.5f, py = pixel.y + 0.5f;
    unsigned pairs = 0;
    const auto fetch = [&](std::uint32_t at) {
        std::uint32_t g = bins.instances[at];
        if (bins.gaussians) g = bins.gaussians[g];
        return splats[g];
    };
    PackedSplat next{};  // loaded while those before are blended
    if (begin + lane < end) next = fetch(begin + lane);
    std::uint32_t base = begin;
    for (; base < end; base += 32) {
        if (__all_sync(~0u, p.t < image.cutoffs.transmittance)) break;
        if (kForBackward && base > begin && (base - begin) % kChunk == 0)
            trail.checkpoints[(std::size_t(record.first_checkpoint) + (base - begin) / kChunk - 1) * kCudaTilePixels +
                              threadIdx.x] = make_float4(p.r, p.g, p.b, p.t);
        const Splat<float> mine = next.splat();
        const bool hit = base + lane < end && reaches(mine, sub_tile);
        const unsigned hits = __ballot_sync(~0u, hit);
        const int place = __popc(hits & ((1u << lane) - 1)), count = __popc(hits);
        if (hit) batch.store(place, mine);
        if (base + 32 + lane < end) next = fetch(base + 32 + lane);
        __syncwarp();
        // Four splats at a time: their alphas are independent, and a warp alone on a long list hides their latency so.
        unsigned blended = 0;
        for (int k = 0; k < count; k += kAtOnce) {
            SplatBatch::Entry s[kAtOnce];
            float alpha[kAtOnce];
#pragma unroll
            for (int u = 0; u < kAtOnce; ++u) {
                s[u] = batch.load(k + u < count ? k + u : k);
                alpha[u] = fragment_alpha(s[u].shape, px, py).alpha;
            }
#pragma unroll
            for (int u = 0; u < kAtOnce; ++u) {
                if (k + u >= count) break;
                if (kForBackward)
                    blended |=
                        unsigned(__any_sync(~0u, alpha[u] >= image.cutoffs.alpha && p.t >= image.cutoffs.transmittance))
                        << (k + u);
                blend_fragment<float, float>(p, alpha[u], s[u].r, s[u].g, s[u].b, image.cutoffs);
            }
        }
        if (kForBackward) {
            const unsigned listed = __ballot_sync(~0u, hit && (blended >> place & 1));
            if (lane == 0) hits_out[(base - begin) / 32 * kSubTiles] = listed;
            pairs += __popc(listed);
        }
        __syncwarp();
    }
    if (inside) write_pixel(image, pixel, p);
    if (kForBackward) list_chunks(record, tile, min(base, end) - begin, pairs, trail, control);
}

}  // namespace

void CudaBlend::take(Carver& c, std::int64_t capacity, int num_tiles) {
    capacity_ = capacity;
    // A list of n instances has ceil(n / kChunk) chunks, and one checkpoint less.
    trail_.checkpoints = c.take<float4>(std::size_t(capacity / kChunk) * kCudaTilePixels);
    trail_.chunks = c.take<BlendChunk>(capacity / kChunk + num_tiles);
    trail_.hits = c.take<std::uint32_t>((capacity / 32 + num_tiles + 1) * kSubTiles);
    trail_.processed = c.take<std::uint32_t>(std::size_t(num_tiles) * kSubTiles);
}

void CudaBlend::forward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, StepControl* control,
                        bool for_backward, cudaStream_t stream) {
    if (for_backward)
        blend_forward<true><<<bins.num_tiles(), kCudaTilePixels, 0, stream>>>(bins, splats, image, control, trail_);
    else
        blend_forward<false><<<bins.num_tiles(), kCudaTilePixels, 0, stream>>>(bins, splats, image, control, {});
    GS_CUDA_LAUNCHED("blend_forward");
}

}  // namespace gs
