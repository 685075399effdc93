// SPDX-License-Identifier: Apache-2.0
// The forward pass: a warp per sub-tile blends the list of its tile.
//
// Blending goes from front to back, so a warp cannot share its list with others, and the warps of the longest lists
// would work on alone while the rest of the device waits. A tile whose list is long beside the view's total is
// therefore blended by four blocks: a warp has a quarter of a sub-tile, and its lanes hold eight pixels times four
// splats that follow each other.
#include "kernels/blend/sub_tile_cuda.h"

namespace gs {
namespace {

/// The pixels of a warp: a sub-tile with one splat at a time, or a quarter of one with four splats abreast.
template <int kAbreast> struct WarpPixels {
    static_assert(kAbreast == 1 || kAbreast == 4);
    static constexpr int kWidth = kAbreast == 1 ? kSubX : kSubX / 2, kHeight = kAbreast == 1 ? kSubY : kSubY / 2;
    static constexpr int kPixels = kWidth * kHeight;

    int2 corner;
    int slot;     ///< which of the splats abreast this lane evaluates
    int2 pixel;   ///< of this lane
    int in_tile;  ///< its number among the tile's pixels, warp after warp of whole sub-tiles

    __device__ WarpPixels(int2 tile_corner, int sub_tile, int quarter, int lane) {
        const int2 offset = {quarter % 2 * kWidth, quarter / 2 * kHeight},
                   whole = sub_tile_corner(tile_corner, sub_tile);
        const int2 in_corner = {lane % kPixels % kWidth, lane % kPixels / kWidth};
        corner = {whole.x + offset.x, whole.y + offset.y};
        slot = lane / kPixels;
        pixel = {corner.x + in_corner.x, corner.y + in_corner.y};
        in_tile = sub_tile * 32 + (offset.y + in_corner.y) * kSubX + offset.x + in_corner.x;
    }
};

struct BlockMemory {
    SplatBatch batches[kSubTiles];
    unsigned processed, pairs;  ///< instances until all pixels of the block were finished; pixels times hits
    unsigned first_chunk;
};

/// Adds up the colours of the lanes that share a pixel.
template <int kAbreast> __device__ PixelForward<float> whole_pixel(PixelForward<float> p) {
    if constexpr (kAbreast == 4)
        for (int d = 8; d < 32; d *= 2) {
            p.r += __shfl_xor_sync(~0u, p.r, d);
            p.g += __shfl_xor_sync(~0u, p.g, d);
            p.b += __shfl_xor_sync(~0u, p.b, d);
        }
    return p;
}

/// Blends as many splats as lie abreast. Returns whether this lane's fragment changed its pixel.
template <int kAbreast>
__device__ bool blend_abreast(PixelForward<float>& p, int slot, float alpha, const SplatBatch::Entry& s,
                              const Cutoffs<float>& cutoffs) {
    if constexpr (kAbreast == 1) {
        const bool active = alpha >= cutoffs.alpha && p.t >= cutoffs.transmittance;
        blend_fragment<float, float>(p, alpha, s.r, s.g, s.b, cutoffs);
        return active;
    }
    if (!(alpha >= cutoffs.alpha)) alpha = 0;
    const float passed = 1 - alpha;
    float through = passed;  // this splat and those before it
    float before = __shfl_up_sync(~0u, through, 8);
    if (slot >= 1) through *= before;
    before = __shfl_up_sync(~0u, through, 16);
    if (slot >= 2) through *= before;
    before = __shfl_up_sync(~0u, through, 8);
    const float t = slot ? p.t * before : p.t;
    const bool open = t >= cutoffs.transmittance, active = open && alpha > 0;
    const float w = active ? t * alpha : 0;
    p.r = gs_fma(w, s.r, p.r), p.g = gs_fma(w, s.g, p.g), p.b = gs_fma(w, s.b, p.b);
    // The last splat that found the pixel unfinished leaves the least.
    float left = open ? t - w : p.t;
    left = fminf(left, __shfl_xor_sync(~0u, left, 8));
    p.t = fminf(left, __shfl_xor_sync(~0u, left, 16));
    return active;
}

__device__ void write_pixel(const BlendImage& image, int2 pixel, const PixelForward<float>& p) {
    const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x, plane = std::size_t(image.width) * image.height;
    image.rgb[i] = p.r + p.t * image.background.x;
    image.rgb[i + plane] = p.g + p.t * image.background.y;
    image.rgb[i + 2 * plane] = p.b + p.t * image.background.z;
    image.transmittance[i] = p.t;
}

/// Lists the chunks of a tile's first `processed` instances for the backward pass. All threads of the block take part.
__device__ void list_chunks(BlockMemory& shared, int tile, std::uint32_t tile_begin, unsigned processed,
                            const BlendTrail& trail, StepControl* control) {
    const unsigned count = (processed + kChunk - 1) / kChunk;
    if (threadIdx.x == 0 && count) shared.first_chunk = atomicAdd(&control->num_chunks, count);
    __syncthreads();
    for (std::uint32_t k = threadIdx.x; k < count; k += kCudaTilePixels)
        trail.chunks[shared.first_chunk + k] = {std::uint32_t(tile), k * kChunk,
                                                k ? first_checkpoint(tile_begin) + k - 1 : 0};
}

/// Blends a tile, or a quarter of each of its sub-tiles. All threads of a block call this.
template <bool kForBackward, int kAbreast>
__device__ void blend_tile(BlockMemory& shared, const CudaBins& bins, int tile, int quarter,
                           const PackedSplat* __restrict__ splats, const BlendImage& image,
                           StepControl* __restrict__ control, const BlendTrail& trail) {
    constexpr int kAtOnce = kAbreast == 1 ? 4 : 2;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const WarpPixels<kAbreast> mine(tile_corner(tile, bins.tiles_x), warp, quarter, lane);
    const bool inside = mine.pixel.x < image.width && mine.pixel.y < image.height;
    const std::uint32_t begin = bins.tile_offsets[tile], end = bins.tile_offsets[tile + 1];
    if (kForBackward) {
        if (threadIdx.x == 0) shared.processed = shared.pairs = 0;
        __syncthreads();
    }
    // From here on each warp of a block walks the whole list on its own, 32 instances at a time.
    SplatBatch& batch = shared.batches[warp];
    std::uint32_t* hits_out = trail.hits + (first_group(tile, begin) * kSubTiles + warp);
    PixelForward<float> p{inside ? 1.0f : 0.0f, 0, 0, 0};
    const float px = mine.pixel.x + 0.5f, py = mine.pixel.y + 0.5f;
    unsigned pairs = 0;
    const auto fetch = [&](std::uint32_t at) {
        std::uint32_t g = bins.instances[at];
        if (bins.gaussians) g = bins.gaussians[g];
        return splats[g];
    };
    const auto save_state = [&](std::uint32_t before, const PixelForward<float>& so_far) {
        if (mine.slot == 0)
            trail.checkpoints[std::size_t(first_checkpoint(begin) + before / kChunk - 1) * kCudaTilePixels +
                              mine.in_tile] = make_float4(so_far.r, so_far.g, so_far.b, so_far.t);
    };
    PackedSplat next{};  // loaded while those before are blended
    if (begin + lane < end) next = fetch(begin + lane);
    std::uint32_t base = begin;
    for (; base < end; base += 32) {
        if (__all_sync(~0u, p.t < image.cutoffs.transmittance)) break;
        if (kForBackward && base > begin && (base - begin) % kChunk == 0)
            save_state(base - begin, whole_pixel<kAbreast>(p));
        Splat<float> splat = next.splat();
        const bool hit = base + lane < end && reaches(splat, mine.corner, mine.kWidth, mine.kHeight);
        const unsigned hits = __ballot_sync(~0u, hit), before = (1u << lane) - 1;
        const int count = __popc(hits), place = hit ? __popc(hits & before) : count + __popc(~hits & before);
        // Empty ones fill the last four up, so that the loop needs no limits.
        if (!hit) splat = {};
        if (hit || place < (count + 3) / 4 * 4) batch.store(place, splat);
        if (base + 32 + lane < end) next = fetch(base + 32 + lane);
        __syncwarp();
        // Some steps at a time: their alphas are independent, and a warp alone on a long list hides their latency so.
        unsigned blended = 0;
        for (int k = 0; k < count; k += kAtOnce * kAbreast) {
            SplatBatch::Entry s[kAtOnce];
            float alpha[kAtOnce];
            const unsigned bit = 1u << (k + mine.slot);
#pragma unroll
            for (int u = 0; u < kAtOnce; ++u) {
                s[u] = batch.load(k + u * kAbreast + mine.slot);
                alpha[u] = fragment_alpha(s[u].shape, px, py).alpha;
            }
#pragma unroll
            for (int u = 0; u < kAtOnce; ++u) {
                if (kAbreast > 1 && k + u * kAbreast >= count) break;
                if (blend_abreast<kAbreast>(p, mine.slot, alpha[u], s[u], image.cutoffs) && kForBackward)
                    blended |= bit << (u * kAbreast);
            }
        }
        if (kForBackward) {
            blended = __reduce_or_sync(~0u, blended);
            const unsigned listed = __ballot_sync(~0u, hit && (blended >> place & 1));
            std::uint32_t* out = &hits_out[(base - begin) / 32 * kSubTiles];
            if (lane == 0 && kAbreast == 1) *out = listed;
            if (lane == 0 && kAbreast > 1 && listed) atomicOr(out, listed);
            pairs += __popc(listed);
        }
        __syncwarp();
    }
    p = whole_pixel<kAbreast>(p);
    if (kForBackward && kAbreast > 1)  // where other quarters of the sub-tile go on, the backward pass asks for these
        for (std::uint32_t before = max(1u, (base - begin + kChunk - 1) / kChunk) * kChunk; before < end - begin;
             before += kChunk)
            save_state(before, p);
    if (inside && mine.slot == 0) write_pixel(image, mine.pixel, p);
    if (!kForBackward) return;
    const unsigned processed = min(base, end) - begin;
    if (lane == 0) {
        atomicMax(&trail.processed[tile * kSubTiles + warp], processed);
        atomicMax(&shared.processed, processed);
        atomicAdd(&shared.pairs, pairs * mine.kPixels);
    }
    __syncthreads();
    if (threadIdx.x == 0 && shared.pairs) atomicAdd(&control->num_pairs, (unsigned long long)shared.pairs);
    // One of four blocks knows only of its own pixels: it lists all chunks, of which some may be empty.
    if (kAbreast == 1 || quarter == 0)
        list_chunks(shared, tile, begin, kAbreast == 1 ? shared.processed : end - begin, trail, control);
}

template <bool kForBackward>
__global__ void __launch_bounds__(kCudaTilePixels, 6)
    blend_forward(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image,
                  StepControl* __restrict__ control, BlendTrail trail) {
    __shared__ BlockMemory shared;
    const TileItem item = bins.longest_first[blockIdx.x];
    if (item.is_none()) return;
    if (item.is_whole())
        blend_tile<kForBackward, 1>(shared, bins, item.tile(), 0, splats, image, control, trail);
    else
        blend_tile<kForBackward, 4>(shared, bins, item.tile(), item.quarter(), splats, image, control, trail);
}

}  // namespace

void CudaBlend::take(Carver& c, std::int64_t capacity, int num_tiles) {
    capacity_ = capacity;
    // A list of n instances has ceil(n / kChunk) chunks, and one checkpoint less.
    trail_.checkpoints = c.take<float4>(std::size_t(capacity / kChunk) * kCudaTilePixels);
    trail_.chunks = c.take<BlendChunk>(capacity / kChunk + num_tiles);
    const std::size_t groups = (capacity / 32 + num_tiles + 1) * kSubTiles;
    marks_ = groups + std::size_t(num_tiles) * kSubTiles;
    trail_.hits = c.take<std::uint32_t>(marks_);
    trail_.processed = trail_.hits + groups;
    trail_.next_item = c.take<unsigned>(1);
}

void CudaBlend::forward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, StepControl* control,
                        bool for_backward, cudaStream_t stream) {
    if (for_backward) {
        // The blocks that share a tile add to these.
        GS_CUDA(cudaMemsetAsync(trail_.hits, 0, marks_ * sizeof(std::uint32_t), stream));
        blend_forward<true><<<bins.num_items(), kCudaTilePixels, 0, stream>>>(bins, splats, image, control, trail_);
    } else {
        blend_forward<false><<<bins.num_items(), kCudaTilePixels, 0, stream>>>(bins, splats, image, control, {});
    }
    GS_CUDA_LAUNCHED("blend_forward");
}

}  // namespace gs
