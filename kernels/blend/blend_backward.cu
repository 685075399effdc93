// SPDX-License-Identifier: Apache-2.0
// Backward pass of the blend: a block per chunk, a warp per sub-tile, a lane per pixel.
//
// Per splat and warp, nine sums over 32 pixels are needed. Six of them are moments of h about the splat's mean: linear in
// the moments about the sub-tile's centre, whose weights 1, X, Y, XX, XY, YY are the same for every splat. So the h and w of
// 16 splats are collected as matrices (16 x 32 pixels) and multiplied on the tensor cores by the weights (32 x 6) and by
// dL/dpixel (32 x 3). TF32 holds 11 bits; values are split into a high and a low part, which together hold 22.
#include "kernels/blend/sub_tile_cuda.h"

namespace gs {
namespace {

constexpr int kRows = 16;
constexpr int kStride = 36; ///< of a row in shared memory: 8 rows of 16 bytes then lie in different banks

/// One warp's rows.
struct Rows {
    float h[kRows][kStride], w[kRows][kStride];
    float gradient[3][32]; ///< dL/dpixel
    std::uint8_t index[kRows]; ///< splat of the batch
};

__device__ float high_part(float x) { return __uint_as_float(__float_as_uint(x) & 0xffffe000u); }

/// c += a b, m16n8k8.
__device__ void multiply(float (&c)[4], const float (&a)[4], float b0, float b1) {
    asm("mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, {%0,%1,%2,%3};"
        : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
        : "r"(__float_as_uint(a[0])), "r"(__float_as_uint(a[1])), "r"(__float_as_uint(a[2])), "r"(__float_as_uint(a[3])), "r"(__float_as_uint(b0)),
          "r"(__float_as_uint(b1)));
}

/// Columns 8 step .. 8 step + 7 of the 16 rows, split.
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

/// Multiplies the first `count` rows and adds the sums to the splats they belong to.
template <bool kFixedOrder>
__device__ void flush(Rows& rows, int count, int warp, int lane, float centre_x, float centre_y, const SplatBatch& batch, const std::uint32_t* targets,
                      PackedSums* __restrict__ sums) {
    const int n = lane >> 2, t = lane & 3;
    // Weight n is a power of X times a power of Y; n = 6, 7 have no weight.
    const float x0 = t - 3.5f, x1 = t + 0.5f;
    const float wx0 = n == 1 || n == 4 ? x0 : (n == 3 ? x0 * x0 : (n < 6 ? 1.0f : 0.0f)), wx1 = n == 1 || n == 4 ? x1 : (n == 3 ? x1 * x1 : (n < 6 ? 1.0f : 0.0f));
    float moments[4] = {}, colors[4] = {}, high[4], low[4];
    __syncwarp();
#pragma unroll
    for (int step = 0; step < 4; ++step) { // 8 pixels: one row of the sub-tile
        const float y = step - 1.5f, wy = n == 2 || n == 4 ? y : (n == 5 ? y * y : 1.0f);
        load_rows(rows.h, step, lane, high, low);
        multiply(moments, high, wx0 * wy, wx1 * wy);
        multiply(moments, low, wx0 * wy, wx1 * wy);
        const float g0 = n < 3 ? rows.gradient[n][step * 8 + t] : 0.0f, g1 = n < 3 ? rows.gradient[n][step * 8 + t + 4] : 0.0f;
        const float g0_high = high_part(g0), g1_high = high_part(g1);
        load_rows(rows.w, step, lane, high, low);
        multiply(colors, high, g0_high, g1_high);
        multiply(colors, high, g0 - g0_high, g1 - g1_high);
        multiply(colors, low, g0_high, g1_high);
    }
    __syncwarp();
    // Row n and n + 8, columns 2 t and 2 t + 1: through shared memory to one lane a row.
    float(&out)[kRows][kStride] = rows.h;
    if (t < 3) {
        out[n][2 * t] = moments[0], out[n][2 * t + 1] = moments[1];
        out[n + 8][2 * t] = moments[2], out[n + 8][2 * t + 1] = moments[3];
    }
    if (t < 2) {
        out[n][6 + 2 * t] = colors[0], out[n][7 + 2 * t] = colors[1];
        out[n + 8][6 + 2 * t] = colors[2], out[n + 8][7 + 2 * t] = colors[3];
    }
    __syncwarp();
    const int row = lane & 15;
    if (row < count) {
        const int k = rows.index[row];
        const float* m = out[row];
        const float dx = batch.a[k].x - centre_x, dy = batch.a[k].y - centre_y;
        const float hx = dx * m[0] - m[1], hy = dy * m[0] - m[2];
        PackedSums* to = kFixedOrder ? sums + std::size_t(targets[k]) * kSubTiles + warp : sums + targets[k];
        if (lane < 16) {
            const float4 a = make_float4(m[0], hx, hy, dx * (hx - m[1]) + m[3]);
            if (kFixedOrder)
                to->a = a, to->c.x = m[8];
            else
                add(&to->a, a), atomicAdd(&to->c.x, m[8]);
        } else {
            const float4 b = make_float4(dx * hy - dy * m[1] + m[4], dy * (hy - m[2]) + m[5], m[6], m[7]);
            if (kFixedOrder)
                to->b = b;
            else
                add(&to->b, b);
        }
    }
    __syncwarp();
}

template <bool kFixedOrder>
__global__ void __launch_bounds__(kCudaTilePixels, 5)
    blend_backward(CudaBins bins, const PackedSplat* __restrict__ splats, BlendImage image, const float* __restrict__ dL_dimage, const StepControl* __restrict__ control,
                   const float4* __restrict__ checkpoints, const BlendChunk* __restrict__ chunks, const std::uint8_t* __restrict__ sub_tiles,
                   PackedSums* __restrict__ sums) {
    __shared__ SplatBatch batch;
    __shared__ std::uint32_t targets[kChunk];
    __shared__ std::uint8_t reached[kChunk];
    __shared__ Rows all_rows[kSubTiles];
    if (blockIdx.x >= control->num_chunks) return;
    const BlendChunk chunk = chunks[blockIdx.x];
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const std::uint32_t begin = bins.tile_offsets[chunk.tile] + chunk.first;
    const int count = min(bins.tile_offsets[chunk.tile + 1] - begin, std::uint32_t(kChunk));
    if (int(threadIdx.x) < count) {
        const std::uint32_t instance = bins.instances[begin + threadIdx.x];
        batch.store(threadIdx.x, splats[kFixedOrder ? bins.gaussians[instance] : instance].splat());
        targets[threadIdx.x] = instance;
        reached[threadIdx.x] = sub_tiles[begin + threadIdx.x];
    }
    Rows& rows = all_rows[warp];
    const int2 corner = sub_tile_corner(tile_corner(chunk.tile, bins.tiles_x), warp), pixel = {corner.x + (lane & 7), corner.y + (lane >> 3)};
    PixelBackward<float> p{};
    if (pixel.x < image.width && pixel.y < image.height) {
        const std::size_t i = std::size_t(pixel.y) * image.width + pixel.x, plane = std::size_t(image.width) * image.height;
        float4 before = make_float4(0, 0, 0, 1);
        if (chunk.first) before = checkpoints[std::size_t(chunk.checkpoint) * kCudaTilePixels + threadIdx.x];
        const float t_final = image.transmittance[i];
        const Vec3<float> bg = image.background;
        p.t = before.w;
        p.gr = dL_dimage[i], p.gg = dL_dimage[i + plane], p.gb = dL_dimage[i + 2 * plane];
        p.background = t_final * (p.gr * bg.x + p.gg * bg.y + p.gb * bg.z);
        p.behind = (image.rgb[i] - t_final * bg.x - before.x) * p.gr + (image.rgb[i + plane] - t_final * bg.y - before.y) * p.gg +
                   (image.rgb[i + 2 * plane] - t_final * bg.z - before.z) * p.gb;
    }
    rows.gradient[0][lane] = p.gr, rows.gradient[1][lane] = p.gg, rows.gradient[2][lane] = p.gb;
    const float px = pixel.x + 0.5f, py = pixel.y + 0.5f;
    __syncthreads();
    int filled = 0;
    for (int group = 0; group < count; group += 32) {
        if (__all_sync(~0u, p.t < float(kMinTransmittance))) break;
        unsigned hits = __ballot_sync(~0u, group + lane < count && (reached[group + lane] >> warp & 1));
        for (; hits; hits &= hits - 1) {
            const int k = group + __ffs(hits) - 1;
            const auto s = batch.load(k);
            const float alpha = fragment_alpha(s.shape, px, py).alpha;
            if (!__any_sync(~0u, alpha >= float(kMinAlpha) && p.t >= float(kMinTransmittance))) continue;
            const FragmentGradient<float> d = fragment_gradient<float, float>(p, alpha, s.r, s.g, s.b);
            rows.h[filled][lane] = d.h;
            rows.w[filled][lane] = d.w;
            if (lane == 0) rows.index[filled] = std::uint8_t(k);
            if (++filled == kRows) {
                flush<kFixedOrder>(rows, kRows, warp, lane, corner.x + 0.5f * kSubX, corner.y + 0.5f * kSubY, batch, targets, sums);
                filled = 0;
            }
        }
    }
    if (filled) flush<kFixedOrder>(rows, filled, warp, lane, corner.x + 0.5f * kSubX, corner.y + 0.5f * kSubY, batch, targets, sums);
}

/// One thread per Gaussian: adds up its instances in their order, and the sub-tiles of each in theirs.
__global__ void add_partial_sums(std::int64_t n, SlotMap slots, const PackedSums* __restrict__ partial, PackedSums* __restrict__ sums) {
    const std::int64_t k = std::int64_t(blockIdx.x) * 256 + threadIdx.x;
    if (k >= n) return;
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

}  // namespace

void CudaBlend::take_partial_sums(Carver& c, std::int64_t capacity) { partial_ = c.take<PackedSums>(std::size_t(capacity) * kSubTiles); }

void CudaBlend::backward(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, const float* dL_dimage, StepControl* control, PackedSums* sums,
                         std::int64_t n, const SlotMap* slots, cudaStream_t stream) {
    // Surplus blocks see that there are fewer chunks and leave.
    const unsigned blocks = unsigned(capacity_ / kChunk + bins.num_tiles());
    if (!slots) {
        blend_backward<false><<<blocks, kCudaTilePixels, 0, stream>>>(bins, splats, image, dL_dimage, control, checkpoints_, chunks_, sub_tiles_, sums);
        GS_CUDA_LAUNCHED("blend_backward");
        return;
    }
    GS_CUDA(cudaMemsetAsync(partial_, 0, std::size_t(capacity_) * kSubTiles * sizeof(PackedSums), stream));
    blend_backward<true><<<blocks, kCudaTilePixels, 0, stream>>>(bins, splats, image, dL_dimage, control, checkpoints_, chunks_, sub_tiles_, partial_);
    GS_CUDA_LAUNCHED("blend_backward");
    if (n == 0) return;
    add_partial_sums<<<num_blocks(n, 256), 256, 0, stream>>>(n, *slots, partial_, sums);
    GS_CUDA_LAUNCHED("add_partial_sums");
}

}  // namespace gs
