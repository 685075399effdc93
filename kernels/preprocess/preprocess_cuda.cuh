// SPDX-License-Identifier: Apache-2.0
// The kernels that know the appearance model: projection with colour, and its way back fused with the optimizer; and the same
// with the appearance in kernels of its own, for comparison.
#pragma once

#include <algorithm>

#include "kernels/model_kernels_cuda.h"
#include "kernels/preprocess/appearance_cuda.cuh"
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

/// A warp's rows of residual parameters in shared memory.
template <class Model> struct RowMemory {
    static constexpr int kWidth = Model::kMaxResidual > 0 ? Model::kMaxResidual : 1;
    alignas(16) float rows[32 * kWidth];
    float sums[32]; ///< of the steps that a row has missed
    std::uint8_t list[32];

    /// Loads the rows in `mask` and takes the steps they have missed, here only. `first`: the warp's first Gaussian; `lag`: steps
    /// that this lane's row has missed. Returns the rows that had.
    __device__ unsigned load(const PreprocessArgs& a, std::int64_t first, unsigned mask, int lag) {
        const int width = a.params.residual_width;
        load_rows(mask, width, list, a.params.residual(first), rows);
        const unsigned stale = __ballot_sync(~0u, lag > 0);
        if (stale) {
            sums[threadIdx.x & 31] = a.lazy.table.sums[lag];
            catch_up_rows(stale, width, list, sums, a.lazy.table.epsilon, a.lazy.m + first * width, a.lazy.v + first * width, rows);
        }
        return stale;
    }
};

/// The residual of this lane's Gaussian, 0 where the mode or the degree leaves it out. All lanes call.
template <class Model>
__device__ Vec3<float> warp_residual(const PreprocessArgs& a, std::int64_t i, bool visible, RowMemory<Model>& memory, typename WarpAppearance<Model>::Memory& scratch) {
    if constexpr (Model::kDirectional) {
        const unsigned mask = __ballot_sync(~0u, visible);
        if (mask && a.degree > 0 && a.mode != RenderMode::kBaseOnly) {
            memory.load(a, i - (threadIdx.x & 31), mask, visible ? a.lazy.lag(i) : 0);
            const Vec3<float> direction = visible ? a.params.direction(i, a.camera.position).unit : Vec3<float>{0, 0, 1};
            return WarpAppearance<Model>(scratch, a.shared.prepared).residual(memory.rows, a.params.residual_width, direction, a.degree, visible);
        }
    }
    return {0, 0, 0};
}

/// kFused: with the colour. Otherwise evaluate_colors adds it.
template <class Model, bool kFused>
__global__ void __launch_bounds__(kForwardBlock, 7)
    preprocess_forward(PreprocessArgs a, PackedSplat* __restrict__ splats, CudaBinningInput out, StepControl* __restrict__ control) {
    __shared__ RowMemory<Model> memory[kFused ? kForwardBlock / 32 : 1];
    __shared__ typename WarpAppearance<Model>::Memory scratch[kFused ? kForwardBlock / 32 : 1];
    __shared__ unsigned long long block_instances;
    __shared__ unsigned block_visible;
    if (threadIdx.x == 0) block_instances = 0, block_visible = 0;
    __syncthreads();
    const std::int64_t i = std::int64_t(blockIdx.x) * kForwardBlock + threadIdx.x;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    Splat<float> s{};
    PixelBounds b{0, 0, 0, 0};
    float depth = 0;
    bool valid = i < a.params.count;
    if (valid) valid = make_splat(a.params.geometry(i), a.camera, a.width_padded, a.height_padded, s, b, depth);
    const TileTest tiles = test_tiles(s, b, valid);
    const bool visible = tiles.count > 0;
    const unsigned warp_visible = __ballot_sync(~0u, visible);
    if constexpr (kFused) {
        const Vec3<float> residual = warp_residual<Model>(a, i, visible, memory[warp], scratch[warp]);
        if (visible) s.color = gaussian_color(a.params.activation, a.params.base(i), residual, a.mode);
    }
    if (visible) {
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

/// The separate pass: residuals and colours of the visible Gaussians.
template <class Model> __global__ void __launch_bounds__(kForwardBlock, 7) evaluate_colors(PreprocessArgs a, const std::uint32_t* __restrict__ counts, PackedSplat* __restrict__ splats) {
    __shared__ RowMemory<Model> memory[kForwardBlock / 32];
    __shared__ typename WarpAppearance<Model>::Memory scratch[kForwardBlock / 32];
    const std::int64_t i = std::int64_t(blockIdx.x) * kForwardBlock + threadIdx.x;
    const int warp = threadIdx.x >> 5;
    const bool visible = i < a.params.count && counts[i] > 0;
    const Vec3<float> residual = warp_residual<Model>(a, i, visible, memory[warp], scratch[warp]);
    if (!visible) return;
    a.separate.residuals[i] = residual;
    splats[i].set_color(gaussian_color(a.params.activation, a.params.base(i), residual, a.mode));
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

/// The gradient of the loss for y = base + residual of this lane's Gaussian, from its sums; false: it is not finite.
__device__ inline bool color_gradient(const PreprocessArgs& a, std::int64_t i, const Vec3<float>& residual, const SplatSums<float>& sums, Vec3<float>& out) {
    out = color_backward(a.params.activation, a.params.base(i), residual, {sums.r, sums.g, sums.b});
    return is_finite(out);
}

/// What the warps of a block add to the gradient of the shared weights.
template <class Model> __device__ void store_shared_sums(const WarpAppearance<Model>& appearance, float* block, float* out) {
    constexpr int kShared = kNumSharedOf<Model>;
    for (int warp = 0; warp < kUpdateBlock / 32; ++warp) {
        if (int(threadIdx.x) >> 5 == warp) appearance.add_sums(block, warp == 0);
        __syncthreads();
    }
    for (int k = threadIdx.x; k < kShared; k += kUpdateBlock) out[k] = block[k];
}

/// Gaussians of a block: one after another where a block adds up the gradient of shared weights, else one lot.
template <bool kAddsUp, class Fn> __device__ void for_each_lot(std::int64_t count, Fn fn) {
    const std::int64_t first = std::int64_t(blockIdx.x) * kUpdateBlock + threadIdx.x;
    if constexpr (kAddsUp) {
        for (std::int64_t i = first; i - threadIdx.x < count; i += std::int64_t(gridDim.x) * kUpdateBlock) fn(i);
    } else {
        fn(first);
    }
}

/// The separate pass: gradients of the residual parameters, of the means through the direction, and of the shared weights.
template <class Model>
__global__ void __launch_bounds__(kUpdateBlock, kNumSharedOf<Model> > 0 ? 8 : 9)
    appearance_backward(PreprocessArgs a, const std::uint32_t* __restrict__ counts, const PackedSums* __restrict__ sums, StepControl* __restrict__ control) {
    constexpr int kShared = kNumSharedOf<Model>;
    __shared__ RowMemory<Model> memory[kUpdateBlock / 32];
    __shared__ typename WarpAppearance<Model>::Memory scratch[kUpdateBlock / 32];
    __shared__ alignas(16) float all_gradients[kUpdateBlock / 32][32 * RowMemory<Model>::kWidth];
    __shared__ float shared_sums[kShared > 0 ? kShared : 1];
    if (control->stopped || !isfinite(control->l1 + control->ssim)) return;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, width = a.params.residual_width;
    float* gradients = all_gradients[warp];
    WarpAppearance<Model> appearance(scratch[warp], a.shared.prepared);
    for_each_lot<(kShared > 0)>(a.params.count, [&](std::int64_t i) {
        const bool visible = i < a.params.count && counts[i] > 0;
        const unsigned mask = __ballot_sync(~0u, visible);
        if (!mask) return;
        memory[warp].load(a, i - lane, mask, visible ? a.lazy.lag(i) : 0);
        for (int k = lane; k < 32 * width; k += 32) gradients[k] = 0;
        __syncwarp();
        const ViewDirection<float> direction = visible ? a.params.direction(i, a.camera.position) : ViewDirection<float>{{0, 0, 1}, 0};
        const Vec3<float> residual = appearance.residual(memory[warp].rows, width, direction.unit, a.degree, visible);
        Vec3<float> dL_dy{0, 0, 0}, dL_ddirection;
        const bool finite = visible && color_gradient(a, i, residual, sums[i].sums(), dL_dy);
        appearance.backward(memory[warp].rows, width, direction.unit, a.degree, finite, dL_dy, gradients, dL_ddirection);
        if (visible) a.separate.dL_dmeans[i] = direction_pullback(direction, dL_ddirection);
        __syncwarp();
        store_rows(mask, width, memory[warp].list, gradients, a.separate.dL_dresiduals + (i - lane) * width);
    });
    if constexpr (kShared > 0) store_shared_sums<Model>(appearance, shared_sums, a.shared.sums + std::int64_t(blockIdx.x) * kShared);
}

/// kFused: with the gradients of the appearance. Otherwise they are where appearance_backward left them.
template <class Model, bool kFused>
__global__ void __launch_bounds__(kUpdateBlock, kFused && kNumSharedOf<Model> > 0 ? 8 : 9)
    preprocess_backward(PreprocessArgs a, const std::uint32_t* __restrict__ counts, const PackedSums* __restrict__ sums, ModelArrays arrays, UpdateArgs update,
                        StepControl* __restrict__ control) {
    constexpr int kShared = kFused ? kNumSharedOf<Model> : 0;
    __shared__ RowMemory<Model> memory[kUpdateBlock / 32];
    __shared__ typename WarpAppearance<Model>::Memory scratch[kFused ? kUpdateBlock / 32 : 1];
    __shared__ alignas(16) float all_gradients[kUpdateBlock / 32][32 * RowMemory<Model>::kWidth];
    __shared__ float decays[kUpdateBlock / 32][2][32]; // of the moments m and v of a row that has missed steps
    __shared__ float shared_sums[kShared > 0 ? kShared : 1];
    if (control->stopped) return;
    if (!isfinite(control->l1 + control->ssim)) { // a skipped step moves nothing, residuals that are behind no more than others
        for_each_lot<(kShared > 0)>(a.params.count, [&](std::int64_t i) {
            if (i < a.params.count && a.lazy.last_step) ++a.lazy.last_step[i];
        });
        return;
    }
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const bool with_residual = Model::kMaxResidual > 0 && a.degree > 0; // below degree 1 there is no gradient
    const int width = with_residual ? arrays.width[int(Group::kResidual)] : 0;
    float *parameters = memory[warp].rows, *gradients = all_gradients[warp], *decay_m = decays[warp][0], *decay_v = decays[warp][1];
    WarpAppearance<Model> appearance(scratch[kFused ? warp : 0], a.shared.prepared);
    for_each_lot<(kShared > 0)>(a.params.count, [&](std::int64_t i) {
        const bool valid = i < a.params.count, visible = valid && counts[i] > 0;
        unsigned rows = 0, stale = 0;
        GaussianGradient<float> gradient{};
        Vec3<float> dL_dmean{0, 0, 0}, residual{0, 0, 0};
        bool finite = visible;
        if (with_residual) {
            const unsigned seen = __ballot_sync(~0u, visible);
            rows = !a.lazy.last_step || __popc(seen) >= kManyVisible ? __ballot_sync(~0u, valid) : seen;
            const int lag = rows >> lane & 1 ? a.lazy.lag(i) : 0;
            __syncwarp(); // the lot before is done with its rows
            if (rows) {
                stale = memory[warp].load(a, i - lane, rows, lag);
                for (int k = lane; k < 32 * width; k += 32) gradients[k] = 0;
            }
            if (stale) decay_m[lane] = first_moment_decay(lag), decay_v[lane] = second_moment_decay(lag);
            __syncwarp();
            if (a.lazy.last_step && (rows >> lane & 1)) a.lazy.last_step[i] = a.lazy.step;
            if (seen) {
                if constexpr (kFused) {
                    const ViewDirection<float> direction = visible ? a.params.direction(i, a.camera.position) : ViewDirection<float>{{0, 0, 1}, 0};
                    residual = appearance.residual(parameters, width, direction.unit, a.degree, visible);
                    if (visible) finite = color_gradient(a, i, residual, sums[i].sums(), gradient.base);
                    Vec3<float> dL_ddirection;
                    appearance.backward(parameters, width, direction.unit, a.degree, finite, gradient.base, gradients, dL_ddirection);
                    dL_dmean = direction_pullback(direction, dL_ddirection);
                } else {
                    load_rows(seen, width, memory[warp].list, a.separate.dL_dresiduals + (i - lane) * width, gradients);
                    if (visible) residual = a.separate.residuals[i], dL_dmean = a.separate.dL_dmeans[i];
                }
            }
        }
        if (valid) {
            if (visible) {
                const SplatSums<float> s = sums[i].sums();
                if (!(kFused && with_residual)) finite = color_gradient(a, i, residual, s, gradient.base);
                geometry_backward(a.params.geometry(i), a.camera, s, gradient);
                gradient.geometry.mean += dL_dmean;
                if (!drop_nonfinite(gradient, gradients + lane * width, width)) atomicAdd(&control->num_nonfinite, 1u);
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
        if (!stale) decay_m[lane] = decay_v[lane] = 1;
        update_rows(rows, width, memory[warp].list, parameters, gradients, decay_m, decay_v, update, p, m, v);
    });
    if constexpr (kShared > 0) {
        if (with_residual) store_shared_sums<Model>(appearance, shared_sums, a.shared.sums + std::int64_t(blockIdx.x) * kShared);
    }
}

/// Rows of threads of update_shared_weights, and weights of one of its blocks: 32 bytes, what a read moves at least.
inline constexpr int kSumThreads = 64, kSumWeights = 8;

/// Adds up the blocks' gradients of the shared weights in a fixed order, and takes the optimizer's step.
template <class Model>
__global__ void __launch_bounds__(kSumThreads* kSumWeights)
    update_shared_weights(const float* __restrict__ sums, int rows, ModelArrays arrays, AdamStep<float> step, unsigned* __restrict__ prepared, StepControl* __restrict__ control) {
    constexpr int kShared = kNumSharedOf<Model>;
    __shared__ float partial[kSumThreads][kSumWeights];
    if (control->stopped || !isfinite(control->l1 + control->ssim)) return;
    const int k = blockIdx.x * kSumWeights + threadIdx.x;
    float sum = 0;
    if (k < kShared)
        for (int row = threadIdx.y; row < rows; row += kSumThreads) sum += sums[std::int64_t(row) * kShared + k];
    partial[threadIdx.y][threadIdx.x] = sum;
    for (int half = kSumThreads / 2; half > 0; half /= 2) {
        __syncthreads();
        if (threadIdx.y < half) partial[threadIdx.y][threadIdx.x] += partial[threadIdx.y + half][threadIdx.x];
    }
    if (threadIdx.y > 0 || k >= kShared) return;
    float p = arrays.shared_param[k], m = arrays.shared_m[k], v = arrays.shared_v[k];
    if (!update_shared(p, m, v, partial[0][threadIdx.x], step)) atomicAdd(&control->num_nonfinite, 1u);
    arrays.shared_param[k] = p, arrays.shared_m[k] = m, arrays.shared_v[k] = v;
    WarpAppearance<Model>::prepare(prepared, k, p);
}

template <class Model> __global__ void prepare_shared_weights(const float* weights, unsigned* prepared) {
    const int k = blockIdx.x * 256 + threadIdx.x;
    if (k < kNumSharedOf<Model>) WarpAppearance<Model>::prepare(prepared, k, weights[k]);
}

template <class Model>
void launch_preprocess(const PreprocessArgs& args, PackedSplat* splats, const CudaBinningInput& out, StepControl* control, cudaStream_t stream) {
    const unsigned blocks = num_blocks(args.params.count, kForwardBlock);
    if (!args.separate.residuals) {
        preprocess_forward<Model, true><<<blocks, kForwardBlock, 0, stream>>>(args, splats, out, control);
        GS_CUDA_LAUNCHED("preprocess_forward");
        return;
    }
    preprocess_forward<Model, false><<<blocks, kForwardBlock, 0, stream>>>(args, splats, out, control);
    GS_CUDA_LAUNCHED("preprocess_forward");
    evaluate_colors<Model><<<blocks, kForwardBlock, 0, stream>>>(args, out.counts, splats);
    GS_CUDA_LAUNCHED("evaluate_colors");
}

/// Blocks that the kernels with shared weights run: as many as the device holds at a time.
template <class Model> int shared_blocks() {
    static const int blocks = [] {
        int device = 0, multiprocessors = 0, fused = 0, separate = 0;
        GS_CUDA(cudaGetDevice(&device));
        GS_CUDA(cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, device));
        GS_CUDA(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&fused, preprocess_backward<Model, true>, kUpdateBlock, 0));
        GS_CUDA(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&separate, appearance_backward<Model>, kUpdateBlock, 0));
        return multiprocessors * std::max(fused, separate);
    }();
    return blocks;
}

template <class Model>
void launch_update(const PreprocessArgs& args, const std::uint32_t* counts, const PackedSums* sums, const ModelArrays& arrays, const UpdateArgs& update,
                   StepControl* control, cudaStream_t stream) {
    const unsigned all = num_blocks(args.params.count, kUpdateBlock);
    unsigned blocks = all;
    if constexpr (kNumSharedOf<Model> > 0) blocks = std::min(all, unsigned(shared_blocks<Model>()));
    const bool with_residual = Model::kMaxResidual > 0 && args.degree > 0;
    if (!args.separate.residuals) {
        preprocess_backward<Model, true><<<blocks, kUpdateBlock, 0, stream>>>(args, counts, sums, arrays, update, control);
        GS_CUDA_LAUNCHED("preprocess_backward");
    } else {
        if (with_residual) {
            appearance_backward<Model><<<blocks, kUpdateBlock, 0, stream>>>(args, counts, sums, control);
            GS_CUDA_LAUNCHED("appearance_backward");
        }
        preprocess_backward<Model, false><<<all, kUpdateBlock, 0, stream>>>(args, counts, sums, arrays, update, control);
        GS_CUDA_LAUNCHED("preprocess_backward");
    }
    if constexpr (kNumSharedOf<Model> > 0) {
        if (!with_residual) return; // no gradient, and none before
        update_shared_weights<Model><<<num_blocks(kNumSharedOf<Model>, kSumWeights), dim3(kSumWeights, kSumThreads), 0, stream>>>(args.shared.sums, int(blocks), arrays,
                                                                                                                                 update.shared_step, args.shared.prepared, control);
        GS_CUDA_LAUNCHED("update_shared_weights");
    }
}

template <class Model> void launch_prepare(const float* weights, unsigned* prepared, cudaStream_t stream) {
    prepare_shared_weights<Model><<<num_blocks(kNumSharedOf<Model>, 256), 256, 0, stream>>>(weights, prepared);
    GS_CUDA_LAUNCHED("prepare_shared_weights");
}

template <class Model> ModelKernels model_kernels() {
    ModelKernels kernels{Model::kDirectional, &launch_preprocess<Model>, &launch_update<Model>, {}};
    if constexpr (kNumSharedOf<Model> > 0) kernels.shared = {kNumSharedOf<Model>, WarpAppearance<Model>::kPreparedWords, &launch_prepare<Model>, &shared_blocks<Model>};
    return kernels;
}

}  // namespace gs
