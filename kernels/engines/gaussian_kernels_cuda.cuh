// SPDX-License-Identifier: Apache-2.0
// The kernels that depend on the appearance model: projection with colour, and its gradient fused with the optimizer.
// For comparison there are also separate kernels for the appearance.
#pragma once

#include "appearance/warp_appearance_cuda.cuh"
#include "kernels/engines/model_kernels_cuda.h"
#include "kernels/engines/row_copies_cuda.cuh"
#include "kernels/optimizer/write_rows_cuda.cuh"
#include "kernels/sort/place_splat_cuda.cuh"

namespace gs {

/// Number of Gaussians per block of the forward pass, and target number of blocks per multiprocessor: on H200 eight
/// blocks with 64 registers a thread are faster than seven with 72.
inline constexpr int kForwardBlock = 128, kForwardBlocksAtOnce = 8;

/// Loads all of a Gaussian's geometry at once. Otherwise the compiler moves each load to the first use of its value,
/// behind the tests of earlier values, and each load waits for memory separately.
__device__ inline GaussianGeometry<float> load_geometry(const ParameterView<float>& params, std::int64_t i) {
    GaussianGeometry<float> g = params.geometry(i);
    asm volatile(""
                 : "+f"(g.mean.x), "+f"(g.mean.y), "+f"(g.mean.z), "+f"(g.log_scale.x), "+f"(g.log_scale.y),
                   "+f"(g.log_scale.z), "+f"(g.rotation.w), "+f"(g.rotation.x), "+f"(g.rotation.y), "+f"(g.rotation.z),
                   "+f"(g.raw_opacity));
    return g;
}

/// Loads a Gaussian's base colour, which the compiler would otherwise load only at its first use.
__device__ inline Vec3<float> load_base(const ParameterView<float>& params, std::int64_t i) {
    Vec3<float> base = params.base(i);
    asm volatile("" : "+f"(base.x), "+f"(base.y), "+f"(base.z));
    return base;
}

/// A warp's rows of residual parameters in shared memory.
template <class Model> struct RowMemory {
    static constexpr int kWidth = Model::kMaxResidual > 0 ? Model::kMaxResidual : 1;
    alignas(16) float rows[32 * kWidth];
    float sums[32];  ///< LazyTable::sums of the steps that each row has missed
    std::uint8_t list[32];

    /// Begins to load the rows in `mask`. `first` is the warp's first Gaussian. Only forward passes may have residuals
    /// in half precision; other passes do not contain that code.
    template <bool kForward> __device__ void begin(const PreprocessArgs& a, std::int64_t first, unsigned mask) {
        const int width = a.params.residual_width;
        if (kForward && a.half_residuals)  // the model is up to date
            load_rows(mask, width, list, a.half_residuals + first * width, rows);
        else
            begin_rows(mask, width, list, a.params.residual(first), rows);
    }
    /// Waits for the rows, and applies their missed steps in this memory only. `lag` is the number of steps that this
    /// lane's row has missed. Returns the rows that had missed steps.
    __device__ unsigned end(const PreprocessArgs& a, std::int64_t first, int lag) {
        const int width = a.params.residual_width;
        wait_for_rows();
        const unsigned stale = __ballot_sync(~0u, lag > 0);
        if (stale) {
            sums[threadIdx.x & 31] = a.lazy.table.sums[lag];
            catch_up_rows(stale, width, list, sums, a.lazy.table.epsilon, a.lazy.moments.at(first * width), rows);
        }
        return stale;
    }
};

/// Begins to load the residuals of the warp's Gaussians that may be `visible`, or none if the mode or the degree
/// excludes residuals. Returns whether any are loading. All lanes must call it.
template <class Model>
__device__ bool begin_residual(const PreprocessArgs& a, std::int64_t i, bool visible, RowMemory<Model>& memory) {
    if (!Model::kDirectional || a.degree == 0 || a.mode == RenderMode::kBaseOnly) return false;
    const unsigned mask = __ballot_sync(~0u, visible && i < a.params.num_residuals);
    if (mask) memory.template begin<true>(a, i - (threadIdx.x & 31), mask);
    return mask;
}

/// Returns the residual of this lane's Gaussian, or 0 if none was loaded. All lanes must call it.
template <class Model>
__device__ Vec3<float> warp_residual(const PreprocessArgs& a, std::int64_t i, bool visible, bool begun,
                                     RowMemory<Model>& memory, typename WarpAppearance<Model>::Memory& scratch) {
    if constexpr (Model::kDirectional) {
        if (begun) {
            const bool shown = visible && i < a.params.num_residuals;
            memory.end(a, i - (threadIdx.x & 31), shown ? a.lazy.lag(i) : 0);
            const Vec3<float> direction = shown ? a.params.direction(i, a.camera.position).unit : Vec3<float>{0, 0, 1};
            const Vec3<float> residual =
                WarpAppearance<Model>(scratch, a.shared.prepared)
                    .residual(memory.rows, a.params.residual_width, direction, a.degree, shown);
            if (shown) return residual;
        }
    }
    return {0, 0, 0};
}

/// Projects the Gaussians. With kFused it also computes their colours; otherwise evaluate_colors adds the colours.
template <class Model, bool kFused>
__global__ void __launch_bounds__(kForwardBlock, kForwardBlocksAtOnce)
    preprocess_forward(PreprocessArgs a, PackedSplat* __restrict__ splats, CudaBinningInput out,
                       StepControl* __restrict__ control) {
    __shared__ RowMemory<Model> memory[kFused ? kForwardBlock / 32 : 1];
    __shared__ typename WarpAppearance<Model>::Memory scratch[kFused ? kForwardBlock / 32 : 1];
    begin_view(out, control);
    const std::int64_t i = std::int64_t(blockIdx.x) * kForwardBlock + threadIdx.x;
    const int warp = threadIdx.x >> 5;
    Splat<float> s{};
    PixelBounds b{0, 0, 0, 0};
    float depth = 0;
    bool valid = i < a.params.count;
    if (valid) {
        LensShape<float> lens_shape;
        valid = make_splat(load_geometry(a.params, i), a.camera, a.width_padded, a.height_padded, s, b, depth,
                           a.cutoffs, &lens_shape);
        if (a.lens_shapes && valid) a.lens_shapes[i] = PackedLensShape::of(lens_shape);
    }
    // Residuals and colours load while tiles are tested. Nearly all Gaussians that reach this point touch a tile.
    const bool begun = kFused && begin_residual<Model>(a, i, valid, memory[warp]);
    const Vec3<float> base = kFused && valid ? load_base(a.params, i) : Vec3<float>{0, 0, 0};
    const TileTest tiles = test_tiles(s, b, valid, a.width_padded / kCudaTileX);
    const bool visible = tiles.count > 0;
    if constexpr (kFused) {
        const Vec3<float> residual = warp_residual<Model>(a, i, visible, begun, memory[warp], scratch[warp]);
        if (visible) s.color = gaussian_color(a.params.activation, base, residual, a.mode);
    }
    if (i < a.params.count) place_splat(i, s, b, tiles, a.depth_key, depth, splats, out);
}

/// Computes residuals and colours of the visible Gaussians in the separate pass.
template <class Model>
__global__ void __launch_bounds__(kForwardBlock, kForwardBlocksAtOnce)
    evaluate_colors(PreprocessArgs a, const std::uint32_t* __restrict__ counts, PackedSplat* __restrict__ splats) {
    __shared__ RowMemory<Model> memory[kForwardBlock / 32];
    __shared__ typename WarpAppearance<Model>::Memory scratch[kForwardBlock / 32];
    const std::int64_t i = std::int64_t(blockIdx.x) * kForwardBlock + threadIdx.x;
    const int warp = threadIdx.x >> 5;
    const bool visible = i < a.params.count && counts[i] > 0;
    const bool begun = begin_residual<Model>(a, i, visible, memory[warp]);
    const Vec3<float> residual = warp_residual<Model>(a, i, visible, begun, memory[warp], scratch[warp]);
    if (!visible) return;
    a.separate.residuals[i] = residual;
    splats[i].set_color(gaussian_color(a.params.activation, a.params.base(i), residual, a.mode));
}

/// Number of visible Gaussians in a warp from which all 32 residuals are read and written: contiguous whole rows are
/// faster.
constexpr int kManyVisible = 12;

/// The step of Adam for each residual column: one step for all columns, or one for each in shared memory. (Lanes need
/// different columns at the same time, and reads of different kernel parameters are serialized.)
struct ColumnSteps {
    AdamStep<float> all;
    const AdamStep<float>* each;  ///< or null
    __device__ AdamStep<float> of(int column) const { return each ? each[column] : all; }
};

/// Input and output of Adam for the residual rows of a warp.
struct RowStep {
    int width;
    const float *parameters, *gradients;  ///< (32, width) in shared memory; the parameters include missed steps
    ColumnSteps columns;
    AdamGains<float> gains;
    float* out;  ///< (32, width): the parameters
    MomentRows moments;
    const float *decay_m, *decay_v;  ///< (32): factors of the moments of each row, before the step
    std::uint32_t seed;              ///< seed of the rounding of packed moments
};

/// Takes Adam's step on the selected residual rows of a warp.
__device__ inline void update_rows(unsigned mask, std::uint8_t* list, const RowStep& rows) {
    const float *parameters = rows.parameters, *gradients = rows.gradients;
    float* __restrict__ p = rows.out;
    RowElements elements(mask, rows.width, list);
    for (int done = 0, rounds = elements.rounds(); done < rounds; done += kRowUnroll) {
        int at[kRowUnroll], row[kRowUnroll], column[kRowUnroll];
        float mm[kRowUnroll], vv[kRowUnroll];
#pragma unroll
        for (int u = 0; u < kRowUnroll; ++u) {
            at[u] = elements.next(row[u], column[u]);
            if (at[u] >= 0) rows.moments.load(at[u], mm[u], vv[u]);
        }
#pragma unroll
        for (int u = 0; u < kRowUnroll; ++u) {
            if (at[u] < 0) continue;
            float x = parameters[at[u]];
            rows.moments.unpack(mm[u], vv[u]);
            mm[u] *= rows.decay_m[row[u]], vv[u] *= rows.decay_v[row[u]];
            adam_update(x, mm[u], vv[u], gradients[at[u]], rows.columns.of(column[u]), rows.gains);
            p[at[u]] = x;
            rows.moments.store(at[u], mm[u], vv[u], rows.seed);
        }
    }
}

/// The smallest row width for update_all_rows.
constexpr int kLeastWidth = 4;

/// Takes the step on the `moving` of 32 rows, and writes the other rows unchanged, four values at a time. Three such
/// accesses in flight keep memory busy; with more, the code of warps at different places exceeds the instruction cache.
__device__ inline void update_all_rows(unsigned moving, const RowStep& rows) {
    constexpr int kUnroll = 3;
    const int width = rows.width;
    const float inverse_width = 1 / float(width);
    const ColumnSteps& steps = rows.columns;
    const float *parameters = rows.parameters, *gradients = rows.gradients;
    float* __restrict__ p = rows.out;
    const int lane = threadIdx.x & 31, size = 8 * width;
    for (int e = lane; e < size; e += 32 * kUnroll) {
        float4 mm[kUnroll], vv[kUnroll];
#pragma unroll
        for (int u = 0; u < kUnroll; ++u)
            if (e + 32 * u < size) rows.moments.load4(e + 32 * u, mm[u], vv[u]);
#pragma unroll
        for (int u = 0; u < kUnroll; ++u) {
            const int at = e + 32 * u;
            if (at >= size) break;
            rows.moments.unpack4(mm[u], vv[u]);
            float4 x = reinterpret_cast<const float4*>(parameters)[at];
            const float4 g = reinterpret_cast<const float4*>(gradients)[at];
            const int row = int((4 * at + 0.5f) * inverse_width), own = (row + 1) * width - 4 * at;
            const auto step = [&](int k, float& p, float& m, float& v, float gradient) {
                const int mine = row + (k >= own);
                if (!(moving >> mine & 1)) return;
                m *= rows.decay_m[mine], v *= rows.decay_v[mine];
                adam_update(p, m, v, gradient, steps.each ? steps.each[(4 * at + k) % width] : steps.all, rows.gains);
            };
            step(0, x.x, mm[u].x, vv[u].x, g.x);
            step(1, x.y, mm[u].y, vv[u].y, g.y);
            step(2, x.z, mm[u].z, vv[u].z, g.z);
            step(3, x.w, mm[u].w, vv[u].w, g.w);
            reinterpret_cast<float4*>(p)[at] = x;
            rows.moments.store4(at, mm[u], vv[u], rows.seed);
        }
    }
}

/// Computes the gradient of the loss for y = base + residual of this lane's Gaussian from its sums. Returns false if it
/// is not finite.
__device__ inline bool color_gradient(const PreprocessArgs& a, std::int64_t i, const Vec3<float>& residual,
                                      const SplatSums<float>& sums, Vec3<float>& out) {
    out = color_backward(a.params.activation, a.params.base(i), residual, {sums.r, sums.g, sums.b});
    return is_finite(out);
}

/// The shared memory of a warp in the backward pass. At the end, its sums of the shared weights' gradient reuse this
/// memory.
template <class Model> struct WarpSpace {
    RowMemory<Model> memory;
    alignas(16) float gradients[32 * RowMemory<Model>::kWidth];
    float decays[2][32];  ///< factors of the moments m and v of rows that have missed steps
    typename WarpAppearance<Model>::Memory scratch;
};
template <class Model> struct alignas(16) WarpBytes {
    static constexpr std::size_t kSums = sizeof(float) * kNumSharedOf<Model>;
    unsigned char bytes[sizeof(WarpSpace<Model>) > kSums ? sizeof(WarpSpace<Model>) : kSums];
    __device__ WarpSpace<Model>& space() { return *reinterpret_cast<WarpSpace<Model>*>(bytes); }
    __device__ float* sums() { return reinterpret_cast<float*>(bytes); }
};

/// Returns the number of Gaussians per block of the backward pass. With shared weights it is as large as shared memory
/// allows, since each block writes a row of sums.
template <class Model> constexpr int update_block() {
    if constexpr (kNumSharedOf<Model> == 0) return 64;
    return 8 * sizeof(WarpBytes<Model>) <= 47 * 1024 ? 256 : 128;
}
/// Returns the target number of blocks per multiprocessor: 16 warps with 128 registers a thread for shared weights,
/// else 18 warps with 113.
template <class Model> constexpr int update_blocks_at_once() {
    return kNumSharedOf<Model> != 0 ? 512 / update_block<Model>() : 9;
}

/// Computes the gradients of the appearance of this lane's Gaussian as seen from `eye`. In the warp, the residuals of
/// the lanes in `shown` lie in `space`. Writes the gradients of the residuals' parameters to space.gradients, and
/// computes the gradient of y = base + residual. With kAdds it adds to space.gradients, which otherwise must be 0
/// before. sums() returns the sums of the Gaussian. Returns the gradient of the mean through the direction.
template <class Model, bool kAdds = false, class Sums>
__device__ inline Vec3<float> appearance_gradient(const PreprocessArgs& a, const Vec3<float>& eye, std::int64_t i,
                                                  bool shown, Sums&& sums, WarpAppearance<Model>& appearance,
                                                  WarpSpace<Model>& space, int width, Vec3<float>& dL_dy) {
    const ViewDirection<float> direction = shown ? a.params.direction(i, eye) : ViewDirection<float>{{0, 0, 1}, 0};
    const Vec3<float> residual = appearance.residual(space.memory.rows, width, direction.unit, a.degree, shown);
    const bool finite = shown && color_gradient(a, i, residual, sums(), dL_dy);
    Vec3<float> dL_ddirection;
    appearance.template backward<kAdds>(space.memory.rows, width, direction.unit, a.degree, finite, dL_dy,
                                        space.gradients, dL_ddirection);
    return shown ? direction_pullback(direction, dL_ddirection) : Vec3<float>{0, 0, 0};
}

/// Adds up the gradients of the shared weights of a block's warps in warp order, and writes the block's row, if there
/// are any. Ends the use of `warps`.
template <class Model, int kBlock>
__device__ void store_shared_sums(const WarpAppearance<Model>& appearance, bool any, WarpBytes<Model>* warps,
                                  const SparseRows& rows) {
    constexpr int kShared = kNumSharedOf<Model>, kWarps = kBlock / 32;
    const bool is_set = __syncthreads_or(any);
    if (threadIdx.x == 0) rows.is_set[blockIdx.x] = is_set;
    if (!is_set) return;
    float* const out = rows.values + std::int64_t(blockIdx.x) * kShared;
    float* own = warps[threadIdx.x >> 5].sums();
    __syncwarp();
    if (any)
        appearance.store_sums(own);
    else
        for (int k = threadIdx.x & 31; k < kShared; k += 32) own[k] = 0;
    __syncthreads();
    for (int k = threadIdx.x; k < kShared; k += kBlock) {
        float sum = 0;
#pragma unroll
        for (int warp = 0; warp < kWarps; ++warp) sum += warps[warp].sums()[k];
        out[k] = sum;
    }
}

/// Computes the gradients of the residual parameters, of the means through the direction, and of the shared weights in
/// the separate pass.
template <class Model>
__global__ void __launch_bounds__(update_block<Model>(), update_blocks_at_once<Model>())
    appearance_backward(PreprocessArgs a, const std::uint32_t* __restrict__ counts, const PackedSums* __restrict__ sums,
                        StepControl* __restrict__ control) {
    constexpr int kShared = kNumSharedOf<Model>, kWarps = update_block<Model>() / 32;
    __shared__ WarpBytes<Model> warps[kWarps];
    if (control->takes_no_step()) return;
    const std::int64_t i = std::int64_t(blockIdx.x) * update_block<Model>() + threadIdx.x;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31, width = a.params.residual_width;
    const bool visible = i < a.params.num_residuals && counts[i] > 0;
    const unsigned seen = __ballot_sync(~0u, visible);
    WarpSpace<Model>& space = warps[warp].space();
    WarpAppearance<Model> appearance(space.scratch, a.shared.prepared);
    if (seen) {
        float* gradients = space.gradients;
        space.memory.template begin<false>(a, i - lane, seen);
        for (int k = lane; k < 32 * width; k += 32) gradients[k] = 0;
        space.memory.end(a, i - lane, visible ? a.lazy.lag(i) : 0);
        Vec3<float> dL_dy{0, 0, 0};
        const Vec3<float> dL_dmean = appearance_gradient<Model>(
            a, a.camera.position, i, visible, [&] { return sums[i].sums(); }, appearance, space, width, dL_dy);
        if (visible) a.separate.dL_dmeans[i] = dL_dmean;
        __syncwarp();
        store_rows(seen, width, space.memory.list, gradients, a.separate.dL_dresiduals + (i - lane) * width);
    }
    if constexpr (kShared > 0) store_shared_sums<Model, update_block<Model>()>(appearance, seen, warps, a.shared.sums);
}

/// Does the work of update_gaussian() for this lane's Gaussian. All lanes of a warp with an existing Gaussian call it.
/// Rows of Gaussians that do not move are written unchanged, since a warp writes whole sectors.
__device__ inline void update_gaussian_of_warp(const PreprocessArgs& a, const ModelArrays& arrays,
                                               const UpdateArgs& update, std::int64_t i, float turns,
                                               GaussianGradient<float>& gradient) {
    const std::int64_t first = i - (threadIdx.x & 31);
    const WarpRowWriter write_warp(arrays, first);
    const bool whole = first + 32 <= a.params.count;
    if (!__any_sync(whole ? ~0u : (1u << (a.params.count - first)) - 1, turns > 0)) return;
    update_gaussian(arrays, update, i, turns, gradient, [&](const auto& row) {
        if (whole)
            write_warp(row);
        else
            row.write(arrays, i);
    });
}

/// Returns the lanes that missed steps. If there are any, writes the factors by which this lane's moments decay before
/// it takes `turns` steps at once. All lanes must call it.
template <class Model>
__device__ unsigned decay_moments(float turns, const UpdateArgs& update, WarpSpace<Model>& space) {
    const unsigned stale = __ballot_sync(~0u, turns > 1);
    if (!stale) return 0;
    space.decays[0][threadIdx.x & 31] = 1, space.decays[1][threadIdx.x & 31] = turns > 1 ? update.decay(turns) : 1.0f;
    return stale;
}

/// Takes the step of the residuals of a warp's Gaussians in `moving`, some of which are `stale`. Parameters and
/// gradients of the Gaussians in `rows` are in shared memory.
template <class Model>
__device__ void update_residuals_of_warp(unsigned rows, unsigned moving, unsigned stale, WarpSpace<Model>& space,
                                         const float* gradients, std::int64_t first, std::uint32_t step_seed,
                                         const ModelArrays& arrays, const UpdateArgs& update,
                                         const AdamStep<float>* column_steps) {
    constexpr int k = int(Group::kResidual);
    const int lane = threadIdx.x & 31, width = arrays.width[k];
    float *decay_m = space.decays[0], *decay_v = space.decays[1];
    if (!stale) decay_m[lane] = decay_v[lane] = 1;
    __syncwarp();
    const std::int64_t begin = first * width;
    const std::uint32_t seed = mix_bits(std::uint32_t(first) ^ step_seed);  // seed of the warp and the step
    const ColumnSteps columns{update.steps[k], update.per_column ? column_steps : nullptr};
    const MomentRows moments = MomentRows{arrays.m[k], arrays.v[k]}.at(begin);
    const RowStep step{width,   space.memory.rows, gradients, columns, update.gains, arrays.param[k] + begin,
                       moments, decay_m,           decay_v,   seed};
    if (rows != ~0u || width < kLeastWidth)
        update_rows(moving, space.memory.list, step);
    else
        update_all_rows(moving, step);
}

/// Computes the gradients and takes the optimizer's step. With kFused it computes the gradients of the appearance;
/// otherwise it reads the gradients that appearance_backward wrote.
template <class Model, bool kFused>
__global__ void __launch_bounds__(update_block<Model>(), update_blocks_at_once<Model>())
    preprocess_backward(PreprocessArgs a, const std::uint32_t* __restrict__ counts, const PackedSums* __restrict__ sums,
                        ModelArrays arrays, UpdateArgs update, StepControl* __restrict__ control) {
    constexpr int kShared = kFused ? kNumSharedOf<Model> : 0, kWarps = update_block<Model>() / 32;
    __shared__ WarpBytes<Model> warps[kWarps];
    __shared__ AdamStep<float> column_steps[RowMemory<Model>::kWidth];
    if (control->stopped) return;
    if (update.per_column) {
        for (int k = threadIdx.x; k < RowMemory<Model>::kWidth; k += update_block<Model>())
            column_steps[k] = update.residual_steps[k];
        __syncthreads();
    }
    const std::int64_t i = std::int64_t(blockIdx.x) * update_block<Model>() + threadIdx.x;
    if (control->loss_not_finite) {  // a skipped step changes nothing, not even stale residuals
        if (i < a.params.num_residuals && a.lazy.last_step) ++a.lazy.last_step[i];
        return;
    }
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const bool valid = i < a.params.count, visible = valid && counts[i] > 0;
    const bool with_residual = Model::kMaxResidual > 0 && a.degree > 0;  // below degree 1 the residual has no gradient
    const bool owns = with_residual && i < a.params.num_residuals, shown = owns && visible;
    const int width = with_residual ? arrays.width[int(Group::kResidual)] : 0;
    WarpSpace<Model>& space = warps[warp].space();
    float *gradients = space.gradients, *decay_m = space.decays[0], *decay_v = space.decays[1];
    const unsigned seen = with_residual ? __ballot_sync(~0u, shown) : 0;
    const float turns = valid ? update.turns(arrays, i, visible) : 0;
    unsigned rows = 0, stale = 0;
    GaussianGradient<float> gradient{};
    Vec3<float> dL_dmean{0, 0, 0}, residual{0, 0, 0};
    WarpAppearance<Model> appearance(space.scratch, a.shared.prepared);
    if (with_residual) {
        const bool waits = a.lazy.last_step || arrays.last_step;
        rows = !waits || __popc(seen) >= kManyVisible ? __ballot_sync(~0u, owns) : seen;
        const int lag = rows >> lane & 1 ? a.lazy.lag(i) : 0;
        if (rows) {
            space.memory.template begin<false>(a, i - lane, rows);
            for (int k = lane; k < 32 * width; k += 32) gradients[k] = 0;
            stale = space.memory.end(a, i - lane, lag);
        }
        if (stale) decay_m[lane] = first_moment_decay(lag), decay_v[lane] = second_moment_decay(lag);
        if (arrays.last_step) stale = decay_moments(turns, update, space);
        __syncwarp();
        if (a.lazy.last_step && (rows >> lane & 1)) a.lazy.last_step[i] = a.lazy.step;
        if (seen) {
            if constexpr (kFused) {
                dL_dmean = appearance_gradient<Model>(
                    a, a.camera.position, i, shown, [&] { return sums[i].sums(); }, appearance, space, width,
                    gradient.base);
            } else {
                load_rows(seen, width, space.memory.list, a.separate.dL_dresiduals + (i - lane) * width, gradients);
                if (shown) residual = a.separate.residuals[i], dL_dmean = a.separate.dL_dmeans[i];
            }
        }
    }
    if (valid) {
        if (visible) {
            const SplatSums<float> s = sums[i].sums();
            if (!(kFused && shown)) color_gradient(a, i, residual, s, gradient.base);
            geometry_backward(a.params.geometry(i), a.camera, s, a.camera_rows != nullptr, gradient);
            gradient.geometry.mean += dL_dmean;
            if (drop_nonfinite(gradient, gradients + lane * width, shown ? width : 0))
                add_gradient_statistic(arrays, update.width, update.height, i, gradient);
            else
                atomicAdd(&control->num_nonfinite, 1u);
        }
    }
    if (a.camera_rows && i - lane < a.params.count)
        store_camera_sum(gradient, 1, a.camera_rows + i / 32 * CameraGradient<float>::kSize);
    if (valid) update_gaussian_of_warp(a, arrays, update, i, turns, gradient);
    if (rows)
        update_residuals_of_warp<Model>(rows, arrays.last_step ? seen : rows, stale, space, gradients, i - lane,
                                        mix_bits(a.lazy.step), arrays, update, column_steps);
    if constexpr (kShared > 0) {
        if (with_residual) store_shared_sums<Model, update_block<Model>()>(appearance, seen, warps, a.shared.sums);
    }
}

/// Returns the number of Gaussians per block of step_on_views, and the target number of blocks per multiprocessor.
template <class Model> constexpr int views_block() { return kNumSharedOf<Model> == 0 ? 64 : 128; }
template <class Model> constexpr int views_blocks_at_once() { return kNumSharedOf<Model> == 0 ? 8 : 4; }

/// Computes the mean gradients over the views, and takes the optimizer's step on them. Does nothing unless *decision is
/// kTake. No residual is stale. Adds each view to the statistic of ADC. Leaves out gradients that are not finite: for
/// one view the gradients of geometry and colour, or the whole Gaussian if the sum over the views is not finite. Adds
/// the number of Gaussians with such gradients to *num_nonfinite. The sums of the shared weights' gradients are over
/// all views, those of a camera's gradient of its view alone.
template <class Model>
__global__ void __launch_bounds__(views_block<Model>(), views_blocks_at_once<Model>())
    step_on_views(PreprocessArgs a, const SplatsOfView* __restrict__ views, int num_views, ModelArrays arrays,
                  UpdateArgs update, std::uint32_t step, const StepDecision* __restrict__ decision,
                  unsigned* __restrict__ num_nonfinite) {
    constexpr int kBlock = views_block<Model>(), kWidth = RowMemory<Model>::kWidth, kShared = kNumSharedOf<Model>;
    if (*decision != StepDecision::kTake) return;
    __shared__ WarpBytes<Model> warps[kBlock / 32];
    __shared__ AdamStep<float> column_steps[kWidth];
    if (update.per_column) {
        for (int k = threadIdx.x; k < kWidth; k += kBlock) column_steps[k] = update.residual_steps[k];
        __syncthreads();
    }
    const std::int64_t i = std::int64_t(blockIdx.x) * kBlock + threadIdx.x;
    const int warp = threadIdx.x >> 5, lane = threadIdx.x & 31;
    const bool valid = i < a.params.count;
    const bool with_residual = Model::kMaxResidual > 0 && a.degree > 0;
    const bool owns = with_residual && i < a.params.num_residuals;
    const int width = with_residual ? arrays.width[int(Group::kResidual)] : 0;
    WarpSpace<Model>& space = warps[warp].space();
    float* gradients = space.gradients;
    WarpAppearance<Model> appearance(space.scratch, a.shared.prepared);
    bool moves = valid && !arrays.last_step, any = false, finite = true;
    // No row beyond the last is shown.
    const unsigned group = unsigned(i / 32);
    for (int v = 0; v < num_views && i - lane < a.params.count; ++v) moves |= views[v].places[group].shows(lane);
    // A warp in which no Gaussian moves has nothing to read.
    const unsigned moving = __ballot_sync(~0u, owns && moves);
    const unsigned rows = __popc(moving) >= kManyVisible ? __ballot_sync(~0u, owns) : moving;
    const int views_of_warp = __any_sync(~0u, moves) ? num_views : 0;
    if (rows) {
        space.memory.template begin<false>(a, i - lane, rows);
        for (int k = lane; k < 32 * width; k += 32) gradients[k] = 0;
        space.memory.end(a, i - lane, 0);
    }
    const auto camera_row = [&](int v) {
        return a.camera_rows + (v * num_camera_rows(a.params.count) + group) * CameraGradient<float>::kSize;
    };
    GaussianGradient<float> mean{};
    for (int v = 0; v < views_of_warp; ++v) {
        const SplatsOfView& view = views[v];
        const SplatPlaces places = view.places[group];
        const bool visible = places.shows(lane), shown = owns && visible;
        const std::uint32_t place = visible ? places.place(lane) : 0;
        // Gradients are linear in the sums.
        const auto sums = [&] { return view.sums[place] * (1 / float(num_views)); };
        GaussianGradient<float> gradient{};
        Vec3<float> dL_dmean{0, 0, 0};
        if (__any_sync(~0u, shown)) {
            dL_dmean = appearance_gradient<Model, true>(a, view.camera.position, i, shown, sums, appearance, space,
                                                        width, gradient.base);
            any = true;
        }
        if (visible) {
            const SplatSums<float> s = sums();
            if (!shown) color_gradient(a, i, {0, 0, 0}, s, gradient.base);
            geometry_backward(a.params.geometry(i), view.camera, s, a.camera_rows != nullptr, gradient);
            gradient.geometry.mean += dL_dmean;
            if (drop_nonfinite(gradient, nullptr, 0))
                add_gradient_statistic(arrays, num_views * view.camera.width, num_views * view.camera.height, i,
                                       gradient);
            else
                finite = false;
            mean.add(gradient, 1.0f);
        }
        if (a.camera_rows) store_camera_sum(gradient, float(num_views), camera_row(v));
    }
    for (int v = views_of_warp; a.camera_rows && v < num_views && i - lane < a.params.count; ++v)
        store_camera_sum({}, 0, camera_row(v));
    __syncwarp();
    if (!drop_nonfinite(mean, gradients + lane * width, owns && moves ? width : 0)) finite = false;
    if (!finite) atomicAdd(num_nonfinite, 1u);
    const float turns = valid ? update.turns(arrays, i, moves) : 0;
    if (valid) update_gaussian_of_warp(a, arrays, update, i, turns, mean);
    if (moving) {
        const unsigned stale = decay_moments(turns, update, space);
        update_residuals_of_warp<Model>(rows, moving, stale, space, gradients, i - lane, mix_bits(step), arrays, update,
                                        column_steps);
    }
    if constexpr (kShared > 0) {
        if (with_residual) store_shared_sums<Model, kBlock>(appearance, any, warps, a.shared.sums);
    }
}

/// Adds up the blocks' gradients of the shared weights in a fixed order, and takes the optimizer's step.
template <class Model>
__global__ void __launch_bounds__(kSumThreads* kSumColumns)
    update_shared_weights(SparseRows sums, int rows, ModelArrays arrays, AdamStep<float> step, AdamGains<float> gains,
                          unsigned* __restrict__ prepared, StepControl* __restrict__ control) {
    constexpr int kShared = kNumSharedOf<Model>;
    if (control->takes_no_step()) return;
    const int k = blockIdx.x * kSumColumns + threadIdx.x;
    const float sum = sum_of_set_rows(sums, rows, kShared, k);
    if (threadIdx.y > 0 || k >= kShared) return;
    float p = arrays.shared_param[k], m = arrays.shared_m[k], v = arrays.shared_v[k];
    if (!update_shared(p, m, v, sum, step, gains)) atomicAdd(&control->num_nonfinite, 1u);
    arrays.shared_param[k] = p, arrays.shared_m[k] = m, arrays.shared_v[k] = v;
    WarpAppearance<Model>::prepare(prepared, k, p);
}

template <class Model> __global__ void prepare_shared_weights(const float* weights, unsigned* prepared) {
    const int k = blockIdx.x * 256 + threadIdx.x;
    if (k < kNumSharedOf<Model>) WarpAppearance<Model>::prepare(prepared, k, weights[k]);
}

template <class Model>
void launch_preprocess(const PreprocessArgs& args, PackedSplat* splats, const CudaBinningInput& out,
                       StepControl* control, cudaStream_t stream) {
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

template <class Model>
void launch_update(const PreprocessArgs& args, const std::uint32_t* counts, const PackedSums* sums,
                   const ModelArrays& arrays, const UpdateArgs& update, StepControl* control, cudaStream_t stream) {
    constexpr int kBlock = update_block<Model>();
    const unsigned blocks = num_blocks(args.params.count, kBlock);
    const bool with_residual = Model::kMaxResidual > 0 && args.degree > 0;
    if (!args.separate.residuals) {
        preprocess_backward<Model, true><<<blocks, kBlock, 0, stream>>>(args, counts, sums, arrays, update, control);
        GS_CUDA_LAUNCHED("preprocess_backward");
    } else {
        if (with_residual) {
            appearance_backward<Model><<<blocks, kBlock, 0, stream>>>(args, counts, sums, control);
            GS_CUDA_LAUNCHED("appearance_backward");
        }
        preprocess_backward<Model, false><<<blocks, kBlock, 0, stream>>>(args, counts, sums, arrays, update, control);
        GS_CUDA_LAUNCHED("preprocess_backward");
    }
    if constexpr (kNumSharedOf<Model> != 0) {
        if (!with_residual) return;  // there is no gradient, and was none before
        update_shared_weights<Model>
            <<<num_blocks(kNumSharedOf<Model>, kSumColumns), dim3(kSumColumns, kSumThreads), 0, stream>>>(
                args.shared.sums, int(blocks), arrays, update.shared_step, update.shared_gains, args.shared.prepared,
                control);
        GS_CUDA_LAUNCHED("update_shared_weights");
    }
}

template <class Model>
void launch_step_on_views(const PreprocessArgs& args, const SplatsOfView* views, int num_views,
                          const ModelArrays& arrays, const UpdateArgs& update, std::uint32_t step,
                          const StepDecision* decision, unsigned* num_nonfinite, cudaStream_t stream) {
    constexpr int kBlock = views_block<Model>();
    static_assert(kBlock <= update_block<Model>());
    static_assert(kBlock / 32 * sizeof(WarpBytes<Model>) < 47 * 1024, "a block must fit into shared memory");
    step_on_views<Model><<<num_blocks(args.params.count, kBlock), kBlock, 0, stream>>>(
        args, views, num_views, arrays, update, step, decision, num_nonfinite);
    GS_CUDA_LAUNCHED("step_on_views");
}

template <class Model> void launch_prepare(const float* weights, unsigned* prepared, cudaStream_t stream) {
    prepare_shared_weights<Model><<<num_blocks(kNumSharedOf<Model>, 256), 256, 0, stream>>>(weights, prepared);
    GS_CUDA_LAUNCHED("prepare_shared_weights");
}

template <class Model> ModelKernels model_kernels() {
    ModelKernels kernels{
        Model::kDirectional, &launch_preprocess<Model>, &launch_update<Model>, &launch_step_on_views<Model>, {}};
    if constexpr (kNumSharedOf<Model> != 0)
        kernels.shared = {kNumSharedOf<Model>, WarpAppearance<Model>::kPreparedWords, &launch_prepare<Model>,
                          views_block<Model>()};
    return kernels;
}

}  // namespace gs
