// SPDX-License-Identifier: Apache-2.0
// The two kernels that know the appearance model: projection with colour, and its way back fused with the optimizer.
#pragma once

#include "kernels/model_kernels_cuda.h"
#include "kernels/preprocess/rows_cuda.cuh"

namespace gs {

inline constexpr int kForwardBlock = 128, kUpdateBlock = 64;

/// The tiles a lane's splat reaches. Up to 32 candidates each lane looks at its own; the rows of larger ones are shared by
/// the warp.
struct TileTest {
    unsigned mask;  ///< of up to 32 candidates
    unsigned count;
};
__device__ inline TileTest test_tiles(const Splat<float>& s, const PixelBounds& b, bool valid) {
    const TileRectangle r(b);
    TileTest out{0, 0};
    const bool large = valid && r.size() > 32;
    if (valid && !large) {
        const TileRows rows(s, r);
        for (int y = 0; y < r.height; ++y) {
            const TileRows::Span span = rows.row(r.y0 + y);
            if (span.size() > 0) out.mask |= (~0u >> (32 - span.size())) << (y * r.width + span.x0 - r.x0);
        }
        out.count = __popc(out.mask);
    }
    __syncwarp();
    for (unsigned owners = __ballot_sync(~0u, large); owners; owners &= owners - 1) {
        const int owner = __ffs(owners) - 1;
        const auto of_owner = [&](auto x) { return __shfl_sync(~0u, x, owner); };
        Splat<float> t{};
        t.mean = {of_owner(s.mean.x), of_owner(s.mean.y)};
        t.a = of_owner(s.a), t.b = of_owner(s.b), t.c = of_owner(s.c), t.threshold = of_owner(s.threshold);
        const PackedSplat p = PackedSplat::of(t, {of_owner(b.x_min), of_owner(b.x_max), of_owner(b.y_min), of_owner(b.y_max)});
        const TileRectangle q(p.bounds());
        unsigned count = 0;
        for (int y = q.y0; y < q.y0 + q.height; y += 32) count += __reduce_add_sync(~0u, unsigned(span_of_lane(p, y, q.y0 + q.height).size()));
        if (int(threadIdx.x & 31) == owner) out.count = count;
    }
    return out;
}

template <class Model>
__global__ void __launch_bounds__(kForwardBlock, 7)
    preprocess_forward(PreprocessArgs a, PackedSplat* __restrict__ splats, CudaBinningInput out, StepControl* __restrict__ control) {
    constexpr int kWidth = Model::kMaxResidual > 0 ? Model::kMaxResidual : 1;
    __shared__ alignas(16) float rows[kForwardBlock / 32][32 * kWidth];
    __shared__ float sums[kForwardBlock / 32][32];
    __shared__ std::uint8_t lists[kForwardBlock / 32][32];
    __shared__ unsigned long long block_instances;
    __shared__ unsigned block_visible;
    if (threadIdx.x == 0) block_instances = 0, block_visible = 0;
    __syncthreads();
    const std::int64_t i = std::int64_t(blockIdx.x) * kForwardBlock + threadIdx.x;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    GaussianGeometry<float> g{};
    Splat<float> s{};
    PixelBounds b{0, 0, 0, 0};
    float depth = 0;
    bool valid = i < a.params.count;
    if (valid) {
        g = a.params.geometry(i);
        valid = make_splat(g, a.camera, a.width_padded, a.height_padded, s, b, depth);
    }
    const TileTest tiles = test_tiles(s, b, valid);
    const bool visible = tiles.count > 0;
    const unsigned warp_visible = __ballot_sync(~0u, visible);
    const float* residual = nullptr;
    if constexpr (Model::kMaxResidual > 0) {
        if (warp_visible && a.degree > 0 && a.mode != RenderMode::kBaseOnly) {
            const int width = a.params.residual_width;
            const std::int64_t first = (i - lane) * width;
            load_rows(warp_visible, width, lists[warp], a.params.residuals + first, rows[warp]);
            const int lag = visible ? a.lazy.lag(i) : 0;
            const unsigned stale = __ballot_sync(~0u, lag > 0);
            if (stale) {
                sums[warp][lane] = a.lazy.table.sums[lag];
                catch_up_rows(stale, width, lists[warp], sums[warp], a.lazy.table.epsilon, a.lazy.m + first, a.lazy.v + first, rows[warp]);
            }
            residual = rows[warp] + lane * width;
        }
    }
    if (visible) {
        s.color = gaussian_color<Model>(a.params.activation, a.params.base(i), residual, g.mean, a.camera.position, a.degree, a.mode);
        splats[i] = PackedSplat::of(s, b);
        out.spans[i] = TileSpan::of(TileRectangle(b), tiles.mask);
    }
    if (i < a.params.count) {
        out.counts[i] = tiles.count;
        out.depth_keys[i] = visible ? a.depth_key(depth) : kCulledKey;
    }
    const unsigned instances = __reduce_add_sync(~0u, min(tiles.count, 1u << 26)); // 32 of these fit; more are beyond any capacity
    if (lane == 0 && warp_visible) {
        atomicAdd(&block_instances, (unsigned long long)instances);
        atomicAdd(&block_visible, unsigned(__popc(warp_visible)));
    }
    __syncthreads();
    if (threadIdx.x == 0 && block_visible) {
        atomicAdd(&control->num_instances, block_instances);
        atomicAdd(&control->num_visible, block_visible);
    }
}

/// From this many visible Gaussians in a warp on, the step is taken for all 32 of them: whole rows in a row move faster.
constexpr int kManyVisible = 12;

/// Adam on the selected residual rows of a warp, whose parameters (caught up) and gradients are in shared memory; the moments
/// are multiplied by the factors of their row first.
__device__ inline void update_rows(unsigned mask, int width, std::uint8_t* list, const float* parameters, const float* gradients, const float* decay_m,
                                   const float* decay_v, const UpdateArgs& update, float* __restrict__ p, float* __restrict__ m, float* __restrict__ v) {
    constexpr int kGroup = int(Group::kResidual);
    RowElements elements(mask, width, list);
    for (int done = 0, rounds = elements.rounds(); done < rounds; done += kRowUnroll) {
        int at[kRowUnroll], row[kRowUnroll], column[kRowUnroll];
        float mm[kRowUnroll], vv[kRowUnroll];
#pragma unroll
        for (int u = 0; u < kRowUnroll; ++u) {
            at[u] = elements.next(row[u], column[u]);
            if (at[u] >= 0) mm[u] = m[at[u]], vv[u] = v[at[u]];
        }
#pragma unroll
        for (int u = 0; u < kRowUnroll; ++u) {
            if (at[u] < 0) continue;
            float x = parameters[at[u]];
            mm[u] *= decay_m[row[u]], vv[u] *= decay_v[row[u]];
            adam_update(x, mm[u], vv[u], gradients[at[u]], update.per_column ? update.residual_steps[column[u]] : update.steps[kGroup]);
            p[at[u]] = x, m[at[u]] = mm[u], v[at[u]] = vv[u];
        }
    }
}

/// The same for all 32 rows, none of which has missed a step: four values at a time.
__device__ inline void update_all_rows(int width, const float* parameters, const float* gradients, const AdamStep<float>& step, float* __restrict__ p,
                                       float* __restrict__ m, float* __restrict__ v) {
    constexpr int kUnroll = 3;
    const int lane = threadIdx.x & 31, size = 8 * width;
    for (int e = lane; e < size; e += 32 * kUnroll) {
        float4 mm[kUnroll], vv[kUnroll];
#pragma unroll
        for (int u = 0; u < kUnroll; ++u)
            if (e + 32 * u < size) mm[u] = reinterpret_cast<const float4*>(m)[e + 32 * u], vv[u] = reinterpret_cast<const float4*>(v)[e + 32 * u];
#pragma unroll
        for (int u = 0; u < kUnroll; ++u) {
            const int at = e + 32 * u;
            if (at >= size) break;
            float4 x = reinterpret_cast<const float4*>(parameters)[at];
            const float4 g = reinterpret_cast<const float4*>(gradients)[at];
            adam_update(x.x, mm[u].x, vv[u].x, g.x, step), adam_update(x.y, mm[u].y, vv[u].y, g.y, step);
            adam_update(x.z, mm[u].z, vv[u].z, g.z, step), adam_update(x.w, mm[u].w, vv[u].w, g.w, step);
            reinterpret_cast<float4*>(p)[at] = x, reinterpret_cast<float4*>(m)[at] = mm[u], reinterpret_cast<float4*>(v)[at] = vv[u];
        }
    }
}

template <class Model>
__global__ void __launch_bounds__(kUpdateBlock, 9)
    preprocess_backward(PreprocessArgs a, const std::uint32_t* __restrict__ counts, const PackedSums* __restrict__ sums, ModelArrays arrays, UpdateArgs update,
                        StepControl* __restrict__ control) {
    constexpr int kWidth = Model::kMaxResidual > 0 ? Model::kMaxResidual : 1;
    __shared__ alignas(16) float all_parameters[kUpdateBlock / 32][32 * kWidth], all_gradients[kUpdateBlock / 32][32 * kWidth];
    __shared__ float factors[kUpdateBlock / 32][3][32]; // of a row that has missed steps: sum of the steps, decay of m, decay of v
    __shared__ std::uint8_t lists[kUpdateBlock / 32][32];
    if (control->stopped) return;
    const std::int64_t i = std::int64_t(blockIdx.x) * kUpdateBlock + threadIdx.x;
    if (!isfinite(control->l1 + control->ssim)) { // a skipped step moves nothing, residuals that are behind no more than others
        if (i < a.params.count && a.lazy.last_step) ++a.lazy.last_step[i];
        return;
    }
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const bool valid = i < a.params.count, visible = valid && counts[i] > 0;
    const bool with_residual = Model::kMaxResidual > 0 && a.degree > 0; // below degree 1 there is no gradient
    const int width = with_residual ? arrays.width[int(Group::kResidual)] : 0;
    float *parameters = all_parameters[warp], *gradients = all_gradients[warp];
    unsigned rows = 0, stale = 0;
    if (with_residual) {
        rows = __ballot_sync(~0u, visible);
        if (!a.lazy.last_step || __popc(rows) >= kManyVisible) rows = __ballot_sync(~0u, valid);
        const int lag = rows >> lane & 1 ? a.lazy.lag(i) : 0;
        stale = __ballot_sync(~0u, lag > 0);
        if (rows) load_rows(rows, width, lists[warp], a.params.residual(i - lane), parameters);
        if (stale) {
            factors[warp][0][lane] = a.lazy.table.sums[lag];
            factors[warp][1][lane] = first_moment_decay(lag);
            factors[warp][2][lane] = second_moment_decay(lag);
            catch_up_rows(stale, width, lists[warp], factors[warp][0], a.lazy.table.epsilon, a.lazy.m + (i - lane) * width, a.lazy.v + (i - lane) * width, parameters);
        }
        if (rows)
            for (int k = lane; k < 32 * width; k += 32) gradients[k] = 0;
        __syncwarp();
        if (a.lazy.last_step && (rows >> lane & 1)) a.lazy.last_step[i] = a.lazy.step;
    }
    if (valid) {
        GaussianGradient<float> gradient{};
        float* dL_dresidual = gradients + lane * width;
        if (visible) {
            gaussian_backward<Model>(a.params.geometry(i), a.params.base(i), parameters + lane * width, a.params.activation, a.camera, a.degree, sums[i].sums(), gradient,
                                     dL_dresidual);
            if (!drop_nonfinite(gradient, dL_dresidual, width)) atomicAdd(&control->num_nonfinite, 1u);
        }
        update_gaussian(arrays, update, i, gradient);
    }
    if (!rows) return;
    __syncwarp();
    constexpr int k = int(Group::kResidual);
    const std::int64_t first = (i - lane) * width;
    float *p = arrays.param[k] + first, *m = arrays.m[k] + first, *v = arrays.v[k] + first;
    if (rows == ~0u && !stale && !update.per_column) {
        update_all_rows(width, parameters, gradients, update.steps[k], p, m, v);
        return;
    }
    if (!stale) factors[warp][1][lane] = factors[warp][2][lane] = 1;
    update_rows(rows, width, lists[warp], parameters, gradients, factors[warp][1], factors[warp][2], update, p, m, v);
}

template <class Model>
void launch_preprocess(const PreprocessArgs& args, PackedSplat* splats, const CudaBinningInput& out, StepControl* control, cudaStream_t stream) {
    preprocess_forward<Model><<<num_blocks(args.params.count, kForwardBlock), kForwardBlock, 0, stream>>>(args, splats, out, control);
    GS_CUDA_LAUNCHED("preprocess_forward");
}

template <class Model>
void launch_update(const PreprocessArgs& args, const std::uint32_t* counts, const PackedSums* sums, const ModelArrays& arrays, const UpdateArgs& update,
                   StepControl* control, cudaStream_t stream) {
    preprocess_backward<Model><<<num_blocks(args.params.count, kUpdateBlock), kUpdateBlock, 0, stream>>>(args, counts, sums, arrays, update, control);
    GS_CUDA_LAUNCHED("preprocess_backward");
}

template <class Model> ModelKernels model_kernels() { return {Model::kDirectional, &launch_preprocess<Model>, &launch_update<Model>}; }

}  // namespace gs
