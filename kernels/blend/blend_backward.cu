// SPDX-License-Identifier: Apache-2.0
// The backward pass of the blend, with a warp per chunk and sub-tile and a lane per pixel.
//
// Each splat and warp needs nine sums over 32 pixels. Six of them are moments of h about the splat's mean. These are
// linear in the moments about the sub-tile's centre, whose weights 1, X, Y, XX, XY, YY are the same for every splat. So
// the h and w of 16 splats are collected as matrices (16 x 32 pixels) and multiplied on the tensor cores by the weights
// (32 x 6) and by dL/dpixel (32 x 3). TF32 holds 11 bits; values are split into a high and a low part, which together
// hold 22.
//
// Two lanes share a splat where it is fetched and where its sums are added, so that one request to memory brings or
// takes both halves. While a batch of splats is worked on, the next is on its way.
#include <algorithm>

#include "kernels/blend/sub_tile_cuda.h"

namespace gs {
namespace {

constexpr int kRows = 16;          ///< splats of a batch
constexpr int kAtOnce = 4;         ///< splats whose alphas are evaluated side by side
constexpr int kWarps = 2;          ///< warps of a block, which share nothing but the weights
constexpr int kBlocksAtOnce = 14;  ///< blocks of a multiprocessor
/// The number of floats from row to row in shared memory, so that 8 rows of 16 bytes lie in different banks.
constexpr int kStride = 36;
/// The same for the sums of a batch, of which a warp reads four rows at a time.
constexpr int kSumsStride = 40;
/// The lanes that hold weights of the three colours in a matrix product. Another has zeros for all others.
constexpr int kColorLanes = 12;
constexpr std::uint32_t kNobody = ~0u;

/// The shared memory of one warp.
struct WarpMemory {
    union {
        struct {
            float h[kRows][kStride], w[kRows][kStride];
        };
        float sums[kRows][kSumsStride];  ///< h, hX, hY, hXX, hXY, hYY, r, g, b
    };
    PackedSplat batch[kRows];
    /// dL/dpixel by row of the sub-tile, as the lanes want it: two pixels' high parts, then their low parts.
    float4 gradient[kSubY][kColorLanes + 1];
    std::uint8_t list[kChunk];  ///< instances of the chunk that changed a pixel of the sub-tile
};

/// The weights of the moments by row of the sub-tile, as the lanes want them: those of two pixels.
using MomentWeights = float2[kSubY][32];

/// Returns the weight of moment n of a pixel at (x, y) from the sub-tile's centre: 1, X, Y, XX, XY, YY.
__device__ float moment_weight(int n, float x, float y) {
    const float of_x = n == 1 || n == 4 ? x : (n == 3 ? x * x : 1.0f),
                of_y = n == 2 || n == 4 ? y : (n == 5 ? y * y : 1.0f);
    return n < 6 ? of_x * of_y : 0;
}

__device__ float high_part(float x) { return __uint_as_float(__float_as_uint(x) & 0xffffe000u); }

/// Adds a b to c, as m16n8k8.
__device__ void multiply(float (&c)[4], const float (&a)[4], float b0, float b1) {
    asm("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, {%0,%1,%2,%3};"
        : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
        : "r"(__float_as_uint(a[0])), "r"(__float_as_uint(a[1])), "r"(__float_as_uint(a[2])),
          "r"(__float_as_uint(a[3])), "r"(__float_as_uint(b0)), "r"(__float_as_uint(b1)));
}

/// Loads columns 8 step .. 8 step + 7 of the 16 rows, split into high and low parts.
__device__ void load_rows(const float (&rows)[kRows][kStride], int step, int lane, float (&high)[4], float (&low)[4]) {
    const float* mine = &rows[(lane & 7) + (lane >> 3 & 1) * 8][step * 8 + (lane >> 4) * 4];
    unsigned r[4];
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3}, [%4];"
                 : "=r"(r[0]), "=r"(r[1]), "=r"(r[2]), "=r"(r[3])
                 : "r"(unsigned(__cvta_generic_to_shared(mine)))
                 : "memory");
#pragma unroll
    for (int k = 0; k < 4; ++k) {
        const float x = __uint_as_float(r[k]);
        high[k] = high_part(x);
        low[k] = x - high[k];
    }
}

__device__ void add(float4* to, float4 x) {
#if __CUDA_ARCH__ >= 900
    atomicAdd(to, x);
#else
    atomicAdd(&to->x, x.x), atomicAdd(&to->y, x.y), atomicAdd(&to->z, x.z), atomicAdd(&to->w, x.w);
#endif
}

/// Multiplies all rows and adds the sums to their splats. `target` is that of the splat which this lane and its
/// neighbour share.
template <bool kFixedOrder>
__device__ void flush(WarpMemory& memory, const MomentWeights& weights, std::uint32_t target, int sub_tile, int lane,
                      float centre_x, float centre_y, PackedSums* __restrict__ sums) {
    const int n = lane >> 2, t = lane & 3;
    float moments[4] = {}, colors[4] = {}, high[4], low[4];
    __syncwarp();
#pragma unroll
    for (int step = 0; step < kSubY; ++step) {  // 8 pixels: one row of the sub-tile
        const float2 weight = weights[step][lane];
        load_rows(memory.h, step, lane, high, low);
        multiply(moments, high, weight.x, weight.y);
        multiply(moments, low, weight.x, weight.y);
        const float4 g = memory.gradient[step][min(lane, kColorLanes)];
        load_rows(memory.w, step, lane, high, low);
        multiply(colors, high, g.x, g.y);
        multiply(colors, high, g.z, g.w);
        multiply(colors, low, g.x, g.y);
    }
    __syncwarp();
    // This lane holds rows n and n + 8, columns 2 t and 2 t + 1. Shared memory brings them to two lanes a row.
    if (t < 3) {
        *reinterpret_cast<float2*>(&memory.sums[n][2 * t]) = make_float2(moments[0], moments[1]);
        *reinterpret_cast<float2*>(&memory.sums[n + 8][2 * t]) = make_float2(moments[2], moments[3]);
    }
    if (t < 2) {
        *reinterpret_cast<float2*>(&memory.sums[n][6 + 2 * t]) = make_float2(colors[0], colors[1]);
        *reinterpret_cast<float2*>(&memory.sums[n + 8][6 + 2 * t]) = make_float2(colors[2], colors[3]);
    }
    __syncwarp();
    if (target != kNobody) {
        const int row = lane >> 1;
        const bool second = lane & 1;
        const float4* m = reinterpret_cast<const float4*>(memory.sums[row]);
        const float4 u = m[0], v = m[1];
        const float dx = memory.batch[row].a.x - centre_x, dy = memory.batch[row].a.y - centre_y;
        const float hx = dx * u.x - u.y, hy = dy * u.x - u.z;
        const float4 half = second ? make_float4(dx * hy - dy * u.y + v.x, dy * (hy - u.z) + v.y, v.z, v.w)
                                   : make_float4(u.x, hx, hy, dx * (hx - u.y) + u.w);
        PackedSums* to = sums + (kFixedOrder ? std::size_t(target) * kSubTiles + sub_tile : target);
        float4* const place = &to->a + second;
        const float blue = memory.sums[row][8];
        if (kFixedOrder) {
            *place = half;
            if (second) to->c.x = blue;
        } else {
            add(place, half);
            if (second) atomicAdd(&to->c.x, blue);
        }
    }
    __syncwarp();
}

/// The part of a splat that one of two lanes fetches: a or b, which lie behind each other in memory, and green or blue,
/// which do, too.
struct HalfSplat {
    float4 shape{};
    float color = 0;

    HalfSplat() = default;  ///< of a splat that changes nothing
    __device__ HalfSplat(const PackedSplat& from, int half) : shape((&from.a)[half]), color((&from.c.x)[half]) {}
    __device__ void store(PackedSplat& to, int half) const { (&to.a)[half] = shape, (&to.c.x)[half] = color; }
};

/// Walks the part of a tile's list that `chunk` is, for one sub-tile.
template <bool kFixedOrder>
__device__ void walk_chunk(WarpMemory& memory, const MomentWeights& weights, const BlendChunk& chunk, int sub_tile,
                           const CudaBins& bins, const PackedSplat* __restrict__ splats, const BlendImage& image,
                           const float* __restrict__ dL_dimage, const BlendTrail& trail,
                           PackedSums* __restrict__ sums) {
    const int lane = threadIdx.x & 31;
    // Where its pixels were finished, a sub-tile has neither lists nor states.
    const int count = min(int(trail.processed[chunk.tile * kSubTiles + sub_tile]) - int(chunk.first), kChunk);
    if (count <= 0) return;
    const std::uint32_t begin = chunk.tile_begin + chunk.first;
    const std::uint32_t* hits =
        trail.hits + ((first_group(chunk.tile, chunk.tile_begin) + chunk.first / 32) * kSubTiles + sub_tile);
    int listed = 0;
    {
        const unsigned word_of_lane = lane * 32 < count ? hits[lane * kSubTiles] : 0;
#pragma unroll
        for (int group = 0; group < kChunk / 32; ++group) {
            const unsigned word = __shfl_sync(~0u, word_of_lane, group);
            if (word >> lane & 1)
                memory.list[listed + __popc(word & ((1u << lane) - 1))] = std::uint8_t(group * 32 + lane);
            listed += __popc(word);
        }
    }
    if (listed == 0) return;
    __syncwarp();
    // The instance of this lane's splat in the batch that begins at `first`, and the splat.
    const auto target_from = [&](int first) {
        const int k = first + (lane >> 1);
        return k < listed ? bins.instances[begin + memory.list[k]] : kNobody;
    };
    const auto fetch = [&](std::uint32_t target) {
        if (target == kNobody) return HalfSplat{};
        return HalfSplat(splats[kFixedOrder ? bins.gaussians[target] : target], lane & 1);
    };
    std::uint32_t target = target_from(0), next = target_from(kRows);
    HalfSplat splat = fetch(target);
    const int2 corner = sub_tile_corner({int(chunk.corner & 0xffff), int(chunk.corner >> 16)}, sub_tile),
               pixel = pixel_of(corner, lane);
    PixelBackward<float> p{};
    if (pixel.x < image.width && pixel.y < image.height) {
        const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x,
                          plane = std::size_t(image.width) * image.height;
        float4 before = make_float4(0, 0, 0, 1);
        if (chunk.first)
            before = trail.checkpoints[checkpoint_before(chunk.tile_begin, chunk.first) * kCudaTilePixels +
                                       sub_tile * 32 + lane];
        const Vec3<float> bg = image.background;
        p.t = before.w;
        p.gr = dL_dimage[i], p.gg = dL_dimage[i + plane], p.gb = dL_dimage[i + 2 * plane];
        p.background = image.transmittance[i] * (p.gr * bg.x + p.gg * bg.y + p.gb * bg.z);
        p.behind = (image.rgb[i] - before.x) * p.gr + (image.rgb[i + plane] - before.y) * p.gg +
                   (image.rgb[i + 2 * plane] - before.z) * p.gb;
    }
    {
        const auto keep = [&](int channel, float g) {
            float* parts = &memory.gradient[lane >> 3][channel * 4 + (lane & 3)].x + (lane >> 2 & 1);
            parts[0] = high_part(g), parts[2] = g - high_part(g);
        };
        keep(0, p.gr), keep(1, p.gg), keep(2, p.gb);
    }
    const float px = pixel.x + 0.5f, py = pixel.y + 0.5f, centre_x = corner.x + 0.5f * kSubX,
                centre_y = corner.y + 0.5f * kSubY;
    for (int first = 0; first < listed; first += kRows) {
        splat.store(memory.batch[lane >> 1], lane & 1);
        __syncwarp();
        splat = fetch(next);  // on its way while this batch is worked on
        const std::uint32_t after = target_from(first + 2 * kRows);
        const int rows = min(listed - first, kRows);
#pragma unroll
        for (int k = 0; k < kRows; k += kAtOnce) {
            if (k >= rows) break;
            // All reads come first: behind a write to shared memory the compiler cannot move them ahead.
            float alpha[kAtOnce], slope[kAtOnce];
#pragma unroll
            for (int u = 0; u < kAtOnce; ++u) {
                const PackedSplat& s = memory.batch[k + u];
                alpha[u] = fragment_alpha(s.shape(), px, py).alpha;
                slope[u] = color_gradient(p, s.b.w, s.c.x, s.c.y);
            }
#pragma unroll
            for (int u = 0; u < kAtOnce; ++u) {
                const FragmentGradient<float> d = fragment_gradient<float, float>(p, alpha[u], slope[u], image.cutoffs);
                memory.h[k + u][lane] = d.h;
                memory.w[k + u][lane] = d.w;
            }
        }
        flush<kFixedOrder>(memory, weights, target, sub_tile, lane, centre_x, centre_y, sums);
        target = next, next = after;
    }
}

/// Each warp takes the next chunk and sub-tile when it is done with one. A block of its own for each would leave a
/// fifth of the places for warps empty, since blocks of a few thousand cycles end and begin all the time.
template <bool kFixedOrder>
__global__ void __launch_bounds__(32 * kWarps, kBlocksAtOnce)
    blend_backward(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image,
                   const float* __restrict__ dL_dimage, const StepControl* __restrict__ control, BlendTrail trail,
                   PackedSums* __restrict__ sums) {
    __shared__ alignas(16) WarpMemory memories[kWarps];
    __shared__ MomentWeights weights;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    WarpMemory& memory = memories[warp];
    if (lane < kSubY) memory.gradient[lane][kColorLanes] = {};
#pragma unroll 1
    for (int row = warp; row < kSubY; row += kWarps) {
        const int n = lane >> 2;
        const float x = (lane & 3) + 0.5f - 0.5f * kSubX, y = row + 0.5f - 0.5f * kSubY;
        weights[row][lane] = make_float2(moment_weight(n, x, y), moment_weight(n, x + 4, y));
    }
    __syncthreads();
    const unsigned num_items = control->num_chunks * kSubTiles;
    const auto take = [&] { return lane == 0 ? atomicAdd(trail.next_item, 1u) : 0; };
    unsigned next = take();
    while (true) {
        const unsigned item = __shfl_sync(~0u, next, 0);
        if (item >= num_items) return;
        next = take();  // on its way while this one is worked on
        walk_chunk<kFixedOrder>(memory, weights, trail.chunks[item / kSubTiles], int(item % kSubTiles), bins, splats,
                                image, dL_dimage, trail, sums);
    }
}

/// Adds up the instances of a Gaussian in their order, and the sub-tiles of each in theirs; one thread per Gaussian.
__global__ void add_partial_sums(std::int64_t n, SlotMap slots, const StepControl* __restrict__ control,
                                 const PackedSums* __restrict__ partial, PackedSums* __restrict__ sums) {
    const std::int64_t k = std::int64_t(blockIdx.x) * 256 + threadIdx.x;
    if (k >= n || control->stopped) return;  // slots beyond the capacity do not exist
    const std::size_t begin = k ? slots.slot_ends[k - 1] : 0, end = slots.slot_ends[k];
    PackedSums s{};
    for (std::size_t i = begin * kSubTiles; i < end * kSubTiles; ++i) {
        const PackedSums p = partial[i];
        s.a.x += p.a.x, s.a.y += p.a.y, s.a.z += p.a.z, s.a.w += p.a.w;
        s.b.x += p.b.x, s.b.y += p.b.y, s.b.z += p.b.z, s.b.w += p.b.w;
        s.c.x += p.c.x;
    }
    if (begin < end) sums[slots.order[k]] = s;
}

/// Returns the number of multiprocessors of the current device.
unsigned num_multiprocessors() {
    int device = 0, n = 0;
    GS_CUDA(cudaGetDevice(&device));
    GS_CUDA(cudaDeviceGetAttribute(&n, cudaDevAttrMultiProcessorCount, device));
    return unsigned(n);
}

}  // namespace

void CudaBlend::take_partial_sums(Carver& c, std::int64_t capacity) {
    partial_ = c.take<PackedSums>(std::size_t(capacity) * kSubTiles);
}

void CudaBlend::backward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image,
                         const BlendGradients& gradients, const StepControl* control, cudaStream_t stream) {
    const unsigned blocks = std::min(num_blocks((capacity_ / kChunk + bins.num_tiles()) * kSubTiles, kWarps),
                                     num_multiprocessors() * kBlocksAtOnce);
    const auto [dL_dimage, sums, n, slots] = gradients;
    if (!slots) {
        blend_backward<false>
            <<<blocks, 32 * kWarps, 0, stream>>>(bins, splats, image, dL_dimage, control, trail_, sums);
        GS_CUDA_LAUNCHED("blend_backward");
        return;
    }
    GS_CUDA(cudaMemsetAsync(partial_, 0, std::size_t(capacity_) * kSubTiles * sizeof(PackedSums), stream));
    blend_backward<true><<<blocks, 32 * kWarps, 0, stream>>>(bins, splats, image, dL_dimage, control, trail_, partial_);
    GS_CUDA_LAUNCHED("blend_backward");
    if (n == 0) return;
    add_partial_sums<<<num_blocks(n, 256), 256, 0, stream>>>(n, *slots, control, partial_, sums);
    GS_CUDA_LAUNCHED("add_partial_sums");
}

void CudaBlend::begin_again(cudaStream_t stream) {
    GS_CUDA(cudaMemsetAsync(trail_.next_item, 0, sizeof *trail_.next_item, stream));
    if (trail_.num_zeros > 0)
        GS_CUDA(cudaMemsetAsync(trail_.zeros, 0, trail_.num_zeros * sizeof *trail_.zeros, stream));
}

}  // namespace gs
