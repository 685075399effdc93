// SPDX-License-Identifier: Apache-2.0
// The backward pass of the blend, with a warp per chunk and sub-tile and a lane per pixel.
//
// Each splat and warp needs nine sums over 32 pixels. Six of them are moments of h about the splat's mean. These are
// linear in the moments about the sub-tile's centre, whose weights 1, X, Y, XX, XY, YY are the same for every splat. So
// the h and w of 16 splats are collected as matrices (16 x 32 pixels) and multiplied on the tensor cores by the weights
// (32 x 6) and by dL/dpixel (32 x 3). TF32 holds 11 bits; values are split into a high and a low part, which together
// hold 22.
#include <algorithm>

#include "kernels/blend/sub_tile_cuda.h"

namespace gs {
namespace {

constexpr int kRows = 16;
constexpr int kAtOnce = 4;         ///< splats whose alphas are evaluated side by side
constexpr int kWarps = 2;          ///< warps of a block, which share nothing but the block's resources
constexpr int kBlocksAtOnce = 16;  ///< blocks of a multiprocessor
/// The number of floats from row to row in shared memory, so that 8 rows of 16 bytes lie in different banks.
constexpr int kStride = 36;

/// The shared memory of one warp.
struct WarpMemory {
    float h[kRows][kStride], w[kRows][kStride];
    SplatBatch batch;
    float gradient[3][40];  ///< dL/dpixel of 32 pixels; three lanes of a row's pixel read different banks
    std::uint32_t target[32];
    std::uint8_t list[kChunk];  ///< instances of the chunk that changed a pixel of the sub-tile
};

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

/// Multiplies all rows and adds the sums to their splats. `splat` is the splat of row `lane & 15`, or negative for
/// none.
template <bool kFixedOrder>
__device__ void flush(WarpMemory& memory, int splat, int sub_tile, int lane, float centre_x, float centre_y,
                      PackedSums* __restrict__ sums) {
    const int n = lane >> 2, t = lane & 3;
    // Weight n is a power of X times a power of Y; n = 6, 7 have no weight.
    const float x0 = t - 3.5f, x1 = t + 0.5f;
    const auto weight_x = [&](float x) { return n == 1 || n == 4 ? x : (n == 3 ? x * x : (n < 6 ? 1.0f : 0.0f)); };
    const float wx0 = weight_x(x0), wx1 = weight_x(x1);
    float moments[4] = {}, colors[4] = {}, high[4], low[4];
    __syncwarp();
#pragma unroll
    for (int step = 0; step < 4; ++step) {  // 8 pixels: one row of the sub-tile
        const float y = step - 1.5f, wy = n == 2 || n == 4 ? y : (n == 5 ? y * y : 1.0f);
        load_rows(memory.h, step, lane, high, low);
        multiply(moments, high, wx0 * wy, wx1 * wy);
        multiply(moments, low, wx0 * wy, wx1 * wy);
        const float g0 = n < 3 ? memory.gradient[n][step * 8 + t] : 0.0f,
                    g1 = n < 3 ? memory.gradient[n][step * 8 + t + 4] : 0.0f;
        const float g0_high = high_part(g0), g1_high = high_part(g1);
        load_rows(memory.w, step, lane, high, low);
        multiply(colors, high, g0_high, g1_high);
        multiply(colors, high, g0 - g0_high, g1 - g1_high);
        multiply(colors, low, g0_high, g1_high);
    }
    __syncwarp();
    // This lane holds rows n and n + 8, columns 2 t and 2 t + 1. Shared memory brings them to two lanes a row.
    float(&out)[kRows][kStride] = memory.h;
    if (t < 3) {
        *reinterpret_cast<float2*>(&out[n][2 * t]) = make_float2(moments[0], moments[1]);
        *reinterpret_cast<float2*>(&out[n + 8][2 * t]) = make_float2(moments[2], moments[3]);
    }
    if (t < 2) {
        *reinterpret_cast<float2*>(&out[n][6 + 2 * t]) = make_float2(colors[0], colors[1]);
        *reinterpret_cast<float2*>(&out[n + 8][6 + 2 * t]) = make_float2(colors[2], colors[3]);
    }
    __syncwarp();
    if (splat >= 0) {
        const float4* m = reinterpret_cast<const float4*>(&out[lane & 15][0]);
        const float4 u = m[0], v = m[1];  // h, hX, hY, hXX; hXY, hYY, r, g
        const float dx = memory.batch.a[splat].x - centre_x, dy = memory.batch.a[splat].y - centre_y;
        const float hx = dx * u.x - u.y, hy = dy * u.x - u.z;
        PackedSums* to =
            sums + (kFixedOrder ? std::size_t(memory.target[splat]) * kSubTiles + sub_tile : memory.target[splat]);
        if (lane < 16) {
            const float4 a = make_float4(u.x, hx, hy, dx * (hx - u.y) + u.w);
            if (kFixedOrder)
                to->a = a;
            else
                add(&to->a, a);
        } else {
            const float4 b = make_float4(dx * hy - dy * u.y + v.x, dy * (hy - u.z) + v.y, v.z, v.w);
            const float blue = out[lane & 15][8];
            if (kFixedOrder)
                to->b = b, to->c.x = blue;
            else
                add(&to->b, b), atomicAdd(&to->c.x, blue);
        }
    }
    __syncwarp();
}

/// Walks the part of a tile's list that `chunk` is, for one sub-tile.
template <bool kFixedOrder>
__device__ void walk_chunk(WarpMemory& memory, const BlendChunk& chunk, int sub_tile, const CudaBins& bins,
                           const PackedSplat* __restrict__ splats, const BlendImage& image,
                           const float* __restrict__ dL_dimage, const BlendTrail& trail,
                           PackedSums* __restrict__ sums) {
    const int lane = threadIdx.x & 31;
    // Where its pixels were finished, a sub-tile has neither lists nor states.
    const int count = min(int(trail.processed[chunk.tile * kSubTiles + sub_tile]) - int(chunk.first), kChunk);
    if (count <= 0) return;
    const std::uint32_t tile_begin = bins.tile_offsets[chunk.tile], begin = tile_begin + chunk.first;
    const std::uint32_t* hits =
        trail.hits + ((first_group(chunk.tile, tile_begin) + chunk.first / 32) * kSubTiles + sub_tile);
    int listed = 0;
    {
        const unsigned word_of_lane = lane * 32 < count ? hits[lane * kSubTiles] : 0;
        for (int group = 0; group * 32 < count; ++group) {
            const unsigned word = __shfl_sync(~0u, word_of_lane, group);
            if (word >> lane & 1)
                memory.list[listed + __popc(word & ((1u << lane) - 1))] = std::uint8_t(group * 32 + lane);
            listed += __popc(word);
        }
    }
    if (listed == 0) return;
    const int2 corner = sub_tile_corner(tile_corner(chunk.tile, bins.tiles_x), sub_tile),
               pixel = pixel_of(corner, lane);
    PixelBackward<float> p{};
    if (pixel.x < image.width && pixel.y < image.height) {
        const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x,
                          plane = std::size_t(image.width) * image.height;
        float4 before = make_float4(0, 0, 0, 1);
        if (chunk.first)
            before = trail.checkpoints[std::size_t(chunk.checkpoint) * kCudaTilePixels + sub_tile * 32 + lane];
        const float t_final = image.transmittance[i];
        const Vec3<float> bg = image.background;
        p.t = before.w;
        p.gr = dL_dimage[i], p.gg = dL_dimage[i + plane], p.gb = dL_dimage[i + 2 * plane];
        p.background = t_final * (p.gr * bg.x + p.gg * bg.y + p.gb * bg.z);
        p.behind = (image.rgb[i] - t_final * bg.x - before.x) * p.gr +
                   (image.rgb[i + plane] - t_final * bg.y - before.y) * p.gg +
                   (image.rgb[i + 2 * plane] - t_final * bg.z - before.z) * p.gb;
    }
    memory.gradient[0][lane] = p.gr, memory.gradient[1][lane] = p.gg, memory.gradient[2][lane] = p.gb;
    const float px = pixel.x + 0.5f, py = pixel.y + 0.5f, centre_x = corner.x + 0.5f * kSubX,
                centre_y = corner.y + 0.5f * kSubY;
    __syncwarp();
    for (int base = 0; base < listed; base += 32) {
        const int size = min(listed - base, 32);
        Splat<float> splat{};  // without opacity where there is none: it changes nothing
        if (lane < size) {
            const std::uint32_t instance = bins.instances[begin + memory.list[base + lane]];
            splat = splats[kFixedOrder ? bins.gaussians[instance] : instance].splat();
            memory.target[lane] = instance;
        }
        memory.batch.store(lane, splat);
        __syncwarp();
        for (int first = 0; first < size; first += kRows) {
            const int rows = min(size - first, kRows);
#pragma unroll
            for (int row = 0; row < kRows; row += kAtOnce) {
                if (row >= rows) break;
                // All reads come first: behind a write to shared memory the compiler cannot move them ahead.
                float alpha[kAtOnce], slope[kAtOnce];
#pragma unroll
                for (int u = 0; u < kAtOnce; ++u) {
                    const auto s = memory.batch.load(first + row + u);
                    alpha[u] = fragment_alpha(s.shape, px, py).alpha;
                    slope[u] = color_gradient(p, s.r, s.g, s.b);
                }
#pragma unroll
                for (int u = 0; u < kAtOnce; ++u) {
                    const FragmentGradient<float> d =
                        fragment_gradient<float, float>(p, alpha[u], slope[u], image.cutoffs);
                    memory.h[row + u][lane] = d.h;
                    memory.w[row + u][lane] = d.w;
                }
            }
            const int row = lane & 15;
            flush<kFixedOrder>(memory, row < rows ? first + row : -1, sub_tile, lane, centre_x, centre_y, sums);
        }
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
    const unsigned num_items = control->num_chunks * kSubTiles;
    const auto take = [&] { return (threadIdx.x & 31) == 0 ? atomicAdd(trail.next_item, 1u) : 0; };
    unsigned next = take();
    while (true) {
        const unsigned item = __shfl_sync(~0u, next, 0);
        if (item >= num_items) return;
        next = take();  // on its way while this one is worked on
        walk_chunk<kFixedOrder>(memories[threadIdx.x >> 5], trail.chunks[item / kSubTiles], int(item % kSubTiles), bins,
                                splats, image, dL_dimage, trail, sums);
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
    GS_CUDA(cudaMemsetAsync(trail_.next_item, 0, sizeof *trail_.next_item, stream));
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

}  // namespace gs
