// SPDX-License-Identifier: Apache-2.0
// The forward pass: a block blends the list of its tile, chunk by chunk. It fetches the splats of a chunk and finds the
// sub-tiles that each splat reaches; then one warp per sub-tile blends the splats that reach it.
//
// Blending goes from front to back, so the blocks of the longest lists would run on while the rest of the device is
// idle. A tile whose list is long compared with the view's total is therefore blended by four blocks: a warp processes
// a quarter of a sub-tile, and its lanes hold eight pixels times four consecutive splats.
#include <type_traits>

#include "kernels/blend/blend_device.h"
#include "kernels/blend/sub_tile_cuda.h"
#include "kernels/splat/splat_cuda.h"

namespace gs {
namespace {

// Staging of splats through shared memory to the warps that blend them.
//
// A splat is copied as it is stored, bypassing registers. Warps of the forward pass list the addresses of splats in
// shared memory: computing the addresses from indices took five of 28 instructions a splat.

/// The fields of a PackedSplat that blending reads.
struct StagedSplat {
    float mx, my, qa, qb;
    float qc, opacity, red, green, blue;

    FragmentShape<float> __device__ shape() const { return {mx, my, qa, qb, qc, opacity}; }
};

__device__ inline unsigned shared_address(const void* x) { return unsigned(__cvta_generic_to_shared(x)); }

__device__ inline float4 load_shared4(unsigned at) {
    float4 x;
    asm volatile("ld.shared.v4.f32 {%0,%1,%2,%3}, [%4];"
                 : "=f"(x.x), "=f"(x.y), "=f"(x.z), "=f"(x.w)
                 : "r"(at)
                 : "memory");
    return x;
}
__device__ inline float2 load_shared2(unsigned at) {
    float2 x;
    asm volatile("ld.shared.v2.f32 {%0,%1}, [%2];" : "=f"(x.x), "=f"(x.y) : "r"(at) : "memory");
    return x;
}
/// Loads a splat, whose lens word is not needed. All lanes of a warp, or of a part of it, pass the same address.
__device__ inline StagedSplat load_splat(unsigned at) {
    const float4 a = load_shared4(at), b = load_shared4(at + 16);
    const float2 c = load_shared2(at + 32);
    return {a.x, a.y, a.z, a.w, b.x, b.y, b.w, c.x, c.y};
}

/// Begins to copy a splat, or its shape through a lens, to shared memory; wait_for_splat() completes the copy.
template <class Packed> __device__ inline void begin_splat(Packed& to, const Packed& from) {
#pragma unroll
    for (unsigned k = 0; k < sizeof(Packed); k += 16)
        asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(shared_address(&to) + k),
                     "l"(reinterpret_cast<const char*>(&from) + k)
                     : "memory");
}
__device__ inline void wait_for_splat() { asm volatile("cp.async.wait_all;" ::: "memory"); }

/// The pixels of a warp: a sub-tile with one splat at a time, or a quarter of a sub-tile with four splats abreast.
template <int kAbreast> struct WarpPixels {
    static_assert(kAbreast == 1 || kAbreast == 4);
    static constexpr int kWidth = kAbreast == 1 ? kSubX : kSubX / 2, kHeight = kAbreast == 1 ? kSubY : kSubY / 2;
    static constexpr int kPixels = kWidth * kHeight;

    int2 offset;  ///< offset of the warp's first pixel in the sub-tile
    int slot;     ///< index of the splat abreast that this lane evaluates
    int2 pixel;   ///< pixel of this lane
    int in_tile;  ///< index among the tile's pixels, warp after warp of whole sub-tiles

    __device__ WarpPixels(int2 tile_corner, int sub_tile, int quarter, int lane) {
        offset = {quarter % 2 * kWidth, quarter / 2 * kHeight};
        const int2 corner = sub_tile_corner(tile_corner, sub_tile),
                   inner = {offset.x + lane % kPixels % kWidth, offset.y + lane % kPixels / kWidth};
        slot = lane / kPixels;
        pixel = {corner.x + inner.x, corner.y + inner.y};
        in_tile = sub_tile * 32 + inner.y * kSubX + inner.x;
    }
};

static_assert(kChunk == kCudaTilePixels, "a thread fetches one splat of a chunk");
constexpr int kGroups = kChunk / 32;  ///< groups of 32 splats, one word of bits each
constexpr int kMostAtOnce = 8;        ///< splats that a warp takes from its list at a time

struct BlockMemory {
    PackedSplat splats[2][kChunk];                                ///< splats of a chunk, and of the next one
    PackedSplat nothing;                                          ///< padding splat that changes no pixel
    unsigned reached[2][kGroups][kSubTiles];                      ///< bits of 32 splats that reach a sub-tile
    alignas(16) unsigned lists[kSubTiles][kChunk + kMostAtOnce];  ///< the same as addresses in shared memory
    unsigned processed, pairs;  ///< instances until all pixels of the block were finished; pixels times hits
    unsigned first_chunk;
};
/// The rays of the pixels through a lens, and the shapes of the same splats until they replace the outlines.
struct LensMemory {
    TileRays rays;
    PackedLensShape shapes[2][kChunk];
};
struct NoLensMemory {};

/// The rays of a lane's pixel through a lens. Most splats of a warp are on one face: the ray in its axes is in
/// registers. The lists mark the addresses of the other splats, and of wide ones.
struct LaneRays {
    static constexpr unsigned kOther = 1;

    const TileRays& all;
    const int usual_axis;
    const FaceRay<float> usual;

    __device__ LaneRays(TileRays& rays, const BlendImage& image, int2 pixel)
        : all(rays), usual_axis(rays.find(image, pixel)), usual(rays.of(usual_axis)) {}
    __device__ unsigned mark(const PackedSplat& s) const { return s.lens_word().differs_from(usual_axis) ? kOther : 0; }
    /// Loads some splats, and finds their alphas.
    template <int kNum>
    __device__ void load(const unsigned (&places)[kNum], StagedSplat (&s)[kNum], float (&alpha)[kNum]) const {
        unsigned marks = 0;
#pragma unroll
        for (int u = 0; u < kNum; ++u) marks |= places[u];
        if (marks & kOther) {
#pragma unroll
            for (int u = 0; u < kNum; ++u) {
                const unsigned at = places[u] & ~kOther;
                const PackedSplat splat{load_shared4(at), load_shared4(at + 16), load_shared4(at + 32)};
                const LensShape<float> shape = splat.lens_shape();
                s[u] = {shape.mx, shape.my, shape.qa, shape.qb, shape.qc, splat.b.y, splat.b.w, splat.c.x, splat.c.y};
                alpha[u] = lens_fragment_alpha<float>(shape, s[u].opacity, all.of(shape.axis)).alpha;
            }
        } else {
#pragma unroll
            for (int u = 0; u < kNum; ++u) {
                s[u] = load_splat(places[u]);
                alpha[u] = lens_fragment_alpha<float>(LensShape<float>{s[u].mx, s[u].my, s[u].qa, s[u].qb, s[u].qc},
                                                      s[u].opacity, usual)
                               .alpha;
            }
        }
    }
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
__device__ bool blend_abreast(PixelForward<float>& p, int slot, float alpha, const StagedSplat& s,
                              const Cutoffs<float>& cutoffs) {
    if constexpr (kAbreast == 1) {
        const bool active = is_blended(alpha, p.t, cutoffs);
        if (active) pass_light(p, p.t * alpha, s.red, s.green, s.blue);  // predicated, without a branch
        return active;
    }
    if (!(alpha >= cutoffs.alpha)) alpha = 0;
    const float passed = 1 - alpha;
    float through = passed;  // transmittance of this splat and the splats before it
    float before = __shfl_up_sync(~0u, through, 8);
    if (slot >= 1) through *= before;
    before = __shfl_up_sync(~0u, through, 16);
    if (slot >= 2) through *= before;
    before = __shfl_up_sync(~0u, through, 8);
    const float t = slot ? p.t * before : p.t;
    const bool open = t >= cutoffs.transmittance, active = open && alpha > 0;
    const float w = active ? t * alpha : 0;
    p.r = gs_fma(w, s.red, p.r), p.g = gs_fma(w, s.green, p.g), p.b = gs_fma(w, s.blue, p.b);
    // The last splat that found the pixel unfinished leaves the smallest transmittance.
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
__device__ void list_chunks(BlockMemory& shared, int tile, int2 corner, std::uint32_t tile_begin, unsigned processed,
                            const BlendTrail& trail, StepControl* control) {
    const unsigned count = (processed + kChunk - 1) / kChunk;
    if (threadIdx.x == 0 && count) shared.first_chunk = atomicAdd(&control->num_chunks, count);
    __syncthreads();
    for (std::uint32_t k = threadIdx.x; k < count; k += kCudaTilePixels)
        trail.chunks[shared.first_chunk + k] = {std::uint32_t(tile), tile_begin, k * kChunk,
                                                std::uint32_t(corner.x | corner.y << 16)};
}

/// Writes a warp's list: the addresses of the splats that reach its sub-tile, with their marks, and then kMostAtOnce
/// times the address of a splat that changes no pixel. Returns the number of splats that reach the sub-tile.
template <class Mark> __device__ int list_splats(BlockMemory& shared, int buffer, int warp, int lane, Mark&& mark) {
    unsigned* list = shared.lists[warp];
    const unsigned first = shared_address(&shared.splats[buffer][lane]);
    int listed = 0;
#pragma unroll
    for (int group = 0; group < kGroups; ++group) {
        const unsigned word = shared.reached[buffer][group][warp];
        if (word >> lane & 1)
            list[listed + __popc(word & ((1u << lane) - 1))] =
                first + group * 32 * unsigned(sizeof(PackedSplat)) + mark(shared.splats[buffer][group * 32 + lane]);
        listed += __popc(word);
    }
    if (lane < kMostAtOnce) list[listed + lane] = shared_address(&shared.nothing);
    __syncwarp();
    return listed;
}

/// Records which instances of a chunk changed a pixel. Lane k's `blended` has a bit for each splat of the warp's list
/// from 32 k to 32 k + 31. Returns the number of such instances among the lane-th 32 instances.
template <bool kShared>
__device__ int note_hits(const BlockMemory& shared, int buffer, int warp, int lane, unsigned blended, int num_groups,
                         std::uint32_t* hits) {
    unsigned mine = 0;
    int listed = 0;
#pragma unroll
    for (int group = 0; group < kGroups; ++group) {
        const unsigned word = shared.reached[buffer][group][warp];
        const int place = listed + __popc(word & ((1u << lane) - 1));
        const unsigned of_place = __shfl_sync(~0u, blended, place / 32) >> (place % 32);
        const unsigned changed = __ballot_sync(~0u, word >> lane & of_place & 1);
        if (lane == group) mine = changed;
        listed += __popc(word);
    }
    if (lane >= num_groups) return 0;
    std::uint32_t* out = &hits[lane * kSubTiles];
    if (!kShared)
        *out = mine;
    else if (mine)
        atomicOr(out, mine);
    return __popc(mine);
}

/// Blends a tile, or a quarter of each of its sub-tiles. All threads of a block call this.
template <bool kForBackward, int kAbreast, class Lens>
__device__ void blend_tile(BlockMemory& shared, Lens& lens, const CudaBins& bins, int tile, int quarter,
                           const PackedSplat* __restrict__ splats, const BlendImage& image,
                           StepControl* __restrict__ control, const BlendTrail& trail) {
    constexpr int kAtOnce = kAbreast == 1 ? 4 : 2;
    constexpr bool kLens = std::is_same_v<Lens, LensMemory>;
    static_assert(kAtOnce * kAbreast <= kMostAtOnce);
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const int2 corner = tile_corner(tile, bins.tiles_x);
    const WarpPixels<kAbreast> mine(corner, warp, quarter, lane);
    const bool inside = mine.pixel.x < image.width && mine.pixel.y < image.height;
    const std::uint32_t begin = bins.tile_offsets[tile], end = bins.tile_offsets[tile + 1];
    if (threadIdx.x == 0) {
        shared.processed = shared.pairs = 0;
        shared.nothing = {};
    }
    __syncthreads();
    PixelForward<float> p{inside ? 1.0f : 0.0f, 0, 0, 0};
    const float px = mine.pixel.x + 0.5f, py = mine.pixel.y + 0.5f;
    const auto rays = [&] {
        if constexpr (kLens)
            return LaneRays(lens.rays, image, mine.pixel);
        else
            return lens;
    }();
    const auto fetch = [&](int buffer, std::uint32_t g) {
        begin_splat(shared.splats[buffer][threadIdx.x], splats[g]);
        if constexpr (kLens) begin_splat(lens.shapes[buffer][threadIdx.x], image.lens_shapes[g]);
    };
    const auto save_state = [&](std::uint32_t before, const PixelForward<float>& so_far) {
        if (mine.slot == 0)
            trail.checkpoints[checkpoint_before(begin, before) * kCudaTilePixels + mine.in_tile] =
                make_float4(so_far.r, so_far.g, so_far.b, so_far.t);
    };
    const auto gaussian = [&](std::uint32_t at) {
        if (at >= end) return 0u;
        const std::uint32_t g = bins.instances[at];
        return bins.gaussians ? bins.gaussians[g] : g;
    };
    unsigned pairs = 0, processed = 0;  // instances until this warp's pixels were finished
    int buffer = 0;
    std::uint32_t at = begin + threadIdx.x, next = gaussian(at);  // this thread's instance and its Gaussian
    if (at < end) fetch(0, next);
    next = gaussian(at + kChunk);
    for (std::uint32_t base = begin; base < end; base += kChunk, at += kChunk, buffer ^= 1) {
        wait_for_splat();
        if constexpr (kLens) {
            float& x = shared.splats[buffer][threadIdx.x].a.x;
            x = image.near_x(x, corner.x);
        }
        unsigned reached = 0, word = 0;
        if (at < end)
            reached = reached_sub_tiles(shared.splats[buffer][threadIdx.x].splat(), corner, mine.offset,
                                        {mine.kWidth, mine.kHeight});
        if constexpr (kLens) shared.splats[buffer][threadIdx.x].set_lens_shape(lens.shapes[buffer][threadIdx.x]);
#pragma unroll
        for (int k = 0; k < kSubTiles; ++k) {
            const unsigned reaching = __ballot_sync(~0u, reached >> k & 1);
            if (lane == k) word = reaching;
        }
        if (lane < kSubTiles) shared.reached[buffer][warp][lane] = word;
        const bool open = p.t >= image.cutoffs.transmittance;
        // After this barrier the chunk is complete for all threads, and the previous one is no longer read.
        if (!__syncthreads_or(open)) break;
        if (at + kChunk < end) fetch(buffer ^ 1, next);
        next = gaussian(at + 2 * kChunk);
        if (!__any_sync(~0u, open)) continue;
        if (kForBackward && base > begin) save_state(base - begin, whole_pixel<kAbreast>(p));
        processed = min(base + kChunk, end) - begin;
        const int listed = list_splats(shared, buffer, warp, lane, [&](const PackedSplat& s) {
            if constexpr (kLens)
                return rays.mark(s);
            else
                return 0u;
        });
        const unsigned list = shared_address(shared.lists[warp]);
        unsigned blended_of_lane = 0;
        for (int first = 0; first < listed; first += 32) {
            if (__all_sync(~0u, p.t < image.cutoffs.transmittance)) break;
            // Several steps at a time: their alphas are independent, which hides the latency of a warp alone on a long
            // list.
            unsigned blended = 0;
            for (int k = 0; k < min(listed - first, 32); k += kAtOnce * kAbreast) {
                unsigned places[kAtOnce];
                if constexpr (kAbreast == 1) {
                    const float4 four = load_shared4(list + (first + k) * 4);
                    places[0] = __float_as_uint(four.x), places[1] = __float_as_uint(four.y);
                    places[2] = __float_as_uint(four.z), places[3] = __float_as_uint(four.w);
                } else {
#pragma unroll
                    for (int u = 0; u < kAtOnce; ++u)
                        places[u] = shared.lists[warp][first + k + u * kAbreast + mine.slot];
                }
                StagedSplat s[kAtOnce];
                float alpha[kAtOnce];
                if constexpr (kLens) {
                    rays.load(places, s, alpha);
                } else {
#pragma unroll
                    for (int u = 0; u < kAtOnce; ++u)
                        s[u] = load_splat(places[u]), alpha[u] = fragment_alpha(s[u].shape(), px, py).alpha;
                }
                unsigned bits = 0;
#pragma unroll
                for (int u = 0; u < kAtOnce; ++u)
                    if (blend_abreast<kAbreast>(p, mine.slot, alpha[u], s[u], image.cutoffs) && kForBackward)
                        bits |= 1u << (u * kAbreast);
                blended |= bits << (k + mine.slot);
            }
            if (kForBackward) {
                blended = __reduce_or_sync(~0u, blended);
                if (lane == first / 32) blended_of_lane = blended;
            }
        }
        if (kForBackward)
            pairs += note_hits<(kAbreast > 1)>(
                shared, buffer, warp, lane, blended_of_lane, int(min(end - base, std::uint32_t(kChunk)) + 31) / 32,
                trail.hits + ((first_group(tile, begin) + (base - begin) / 32) * kSubTiles + warp));
    }
    p = whole_pixel<kAbreast>(p);
    if (kForBackward && kAbreast > 1)  // other quarters of the sub-tile may continue, so the backward pass needs these
        for (std::uint32_t before = max(1u, (processed + kChunk - 1) / kChunk) * kChunk; before < end - begin;
             before += kChunk)
            save_state(before, p);
    if (inside && mine.slot == 0) write_pixel(image, mine.pixel, p);
    if (!kForBackward) return;
    pairs = __reduce_add_sync(~0u, pairs);
    if (lane == 0) {
        atomicMax(&trail.processed[tile * kSubTiles + warp], processed);
        atomicMax(&shared.processed, processed);
        atomicAdd(&shared.pairs, pairs * mine.kPixels);
    }
    __syncthreads();
    if (threadIdx.x == 0 && shared.pairs) atomicAdd(&control->num_pairs, (unsigned long long)shared.pairs);
    // One of four blocks has only its own pixels, so all chunks are listed, some of which may be empty.
    if (kAbreast == 1 || quarter == 0)
        list_chunks(shared, tile, corner, begin, kAbreast == 1 ? shared.processed : end - begin, trail, control);
}

template <bool kForBackward, class Lens>
__global__ void __launch_bounds__(kCudaTilePixels, std::is_empty_v<Lens> ? 6 : 5)
    blend_forward(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image,
                  StepControl* __restrict__ control, BlendTrail trail) {
    __shared__ BlockMemory shared;
    __shared__ Lens lens;
    if (kForBackward && blockIdx.x == 0 && threadIdx.x == 0) *trail.next_item = 0;
    if (kForBackward)  // the writes end while the block blends, which leaves memory idle
        for (std::size_t k = blockIdx.x * kCudaTilePixels + threadIdx.x; k < trail.num_zeros;
             k += gridDim.x * kCudaTilePixels)
            trail.zeros[k] = {};
    const TileItem item = bins.longest_first[blockIdx.x];
    if (item.is_none()) return;
    if (item.is_whole())
        blend_tile<kForBackward, 1>(shared, lens, bins, item.tile(), 0, splats, image, control, trail);
    else
        blend_tile<kForBackward, 4>(shared, lens, bins, item.tile(), item.quarter(), splats, image, control, trail);
}

}  // namespace

void CudaBlend::take(Carver& c, std::int64_t capacity, int num_tiles, PackedSums* sums, std::int64_t num_sums) {
    capacity_ = capacity;
    trail_.zeros = reinterpret_cast<float4*>(sums);
    trail_.num_zeros = std::size_t(num_sums) * (sizeof *sums / sizeof(float4));
    // A list of n instances has ceil(n / kChunk) chunks, and one checkpoint less.
    trail_.checkpoints = c.take<float4>(std::size_t(capacity / kChunk) * kCudaTilePixels);
    trail_.chunks = c.take<BlendChunk>(capacity / kChunk + num_tiles);
    // The backward pass reads the words of a whole chunk, even past the last list.
    const std::size_t groups = (capacity / 32 + num_tiles + kChunk / 32) * kSubTiles;
    const std::size_t marks = (groups + std::size_t(num_tiles) * kSubTiles + 3) / 4;
    marks_ = {c.take<uint4>(marks), marks};
    trail_.hits = reinterpret_cast<std::uint32_t*>(marks_.data());
    trail_.processed = trail_.hits + groups;
    trail_.next_item = c.take<unsigned>(1);
}

void CudaBlend::forward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, StepControl* control,
                        bool for_backward, cudaStream_t stream) {
    const auto launch = [&](auto lens) {
        using Lens = decltype(lens);
        const int blocks = bins.num_items();
        if (for_backward)
            blend_forward<true, Lens><<<blocks, kCudaTilePixels, 0, stream>>>(bins, splats, image, control, trail_);
        else
            blend_forward<false, Lens><<<blocks, kCudaTilePixels, 0, stream>>>(bins, splats, image, control, {});
    };
    image.rays ? launch(LensMemory{}) : launch(NoLensMemory{});
    GS_CUDA_LAUNCHED("blend_forward");
}

}  // namespace gs
