// SPDX-License-Identifier: Apache-2.0
// MCMC densification on the device.
#include <thrust/iterator/transform_iterator.h>

#include <cub/device/device_scan.cuh>

#include "kernels/densify/densify_cuda.h"
#include "kernels/densify/mcmc_device.h"
#include "kernels/densify/rows_cuda.h"

namespace gs {
namespace {

struct IsDead {
    ShownOpacities opacities;
    const float* rotations;
    float dead_logit;
    __host__ __device__ bool operator()(std::uint32_t i) const {
        return is_dead(opacities(i), rotations + 4 * std::int64_t(i), dead_logit);
    }
};

/// Sampling weight of a row for relocating dead rows, which are not drawn themselves.
struct LivingWeight {
    IsDead is_dead;
    __host__ __device__ std::uint64_t operator()(std::uint32_t i) const {
        return is_dead(i) ? 0 : sampling_weight(is_dead.opacities.raw_opacities[i]);
    }
};

/// Sampling weight of a row for growing the model.
struct GrowthWeight {
    const float *raw_opacities, *base_second_moments;  ///< the latter is null if only opacity counts
    const float* last_step;                            ///< null if all rows take each step
    double step;
    __host__ __device__ std::uint64_t operator()(std::uint32_t i) const {
        if (!base_second_moments) return sampling_weight(raw_opacities[i]);
        const double missed = last_step ? step - last_step[i] : 0;
        return gradient_weight(raw_opacities[i], base_second_moments + 3 * std::int64_t(i), missed);
    }
};

__global__ void draw_rows(std::int64_t num_draws, std::int64_t n, const std::uint64_t* prefix_sums, std::uint64_t seed,
                          RngStream stream, std::int64_t iteration, std::uint32_t* from, int* copies) {
    const std::int64_t k = thread_row();
    if (k >= num_draws) return;
    from[k] = draw_row(prefix_sums, n, seed, stream, iteration, std::uint32_t(k));
    atomicAdd(&copies[from[k]], 1);
}

__global__ void share_places(std::int64_t n, const int* copies, float min_opacity, float* raw_opacities,
                             float* log_scales) {
    const std::int64_t j = thread_row();
    if (j >= n || copies[j] == 0) return;
    const McmcShare share = mcmc_share(raw_opacities[j], copies[j], min_opacity);
    raw_opacities[j] = share.raw_opacity;
    for (int c = 0; c < 3; ++c) log_scales[3 * j + c] += share.log_scale_shift;
}

/// Sets rows to 0. `rows` may name a row more than once.
__global__ void clear_rows(std::int64_t n, const std::uint32_t* rows, int width, float* data) {
    for_row_values(n, width, [=](std::int64_t k, unsigned c) { data[std::int64_t(rows[k]) * width + c] = 0.0f; });
}

/// Copies row from[k] to row to[k], or to row first + k if `to` is null. No row is both source and target.
__global__ void copy_rows(std::int64_t n, const std::uint32_t* to, std::int64_t first, const std::uint32_t* from,
                          int width, float* data) {
    for_row_values(n, width, [=](std::int64_t k, unsigned c) {
        const std::int64_t target = to ? std::int64_t(to[k]) : first + k;
        data[target * width + c] = data[std::int64_t(from[k]) * width + c];
    });
}

/// The scratch buffers of a densification.
struct McmcSpace {
    std::uint64_t* sums = nullptr;  ///< (n) prefix sums of the weights
    int* copies = nullptr;          ///< (n) number of times that a row was drawn
    std::uint32_t *dead = nullptr, *from = nullptr;
    std::int64_t* num_dead = nullptr;
};

/// Rows that are filled with copies of others.
struct RowsToFill {
    std::int64_t num_rows;
    const std::uint32_t* list;  ///< null: the rows from n on
    RngStream draws;
};

/// Fills `rows` with copies of rows drawn among the first n. Drawn rows get the opacity and scale of their share and
/// lose their moments.
void fill_rows(CudaModel& model, const McmcSpace& space, std::int64_t n, const RowsToFill& rows, float min_opacity,
               std::int64_t iteration, std::uint64_t seed, cudaStream_t stream) {
    const auto [num_rows, to, stream_of_draws] = rows;
    model.rows_moved = true;
    GS_CUDA(cudaMemsetAsync(space.copies, 0, n * sizeof *space.copies, stream));
    draw_rows<<<num_blocks(num_rows, kRowBlock), kRowBlock, 0, stream>>>(num_rows, n, space.sums, seed, stream_of_draws,
                                                                         iteration, space.from, space.copies);
    GS_CUDA_LAUNCHED("draw_rows");
    share_places<<<num_blocks(n, kRowBlock), kRowBlock, 0, stream>>>(
        n, space.copies, min_opacity, model.param[int(Group::kOpacity)].get(), model.param[int(Group::kScale)].get());
    GS_CUDA_LAUNCHED("share_places");
    const unsigned blocks = num_blocks(num_rows, kRowsPerBlock);
    for (int g = 0; g < kNumGroups; ++g) {
        const int width = model.width[g];
        if (width == 0) continue;
        for (auto* moment : model.moments(g)) {
            clear_rows<<<blocks, kRowBlock, 0, stream>>>(num_rows, space.from, width, moment->get());
            GS_CUDA_LAUNCHED("clear_rows");
        }
        copy_rows<<<blocks, kRowBlock, 0, stream>>>(num_rows, to, n, space.from, width, model.param[g].get());
        GS_CUDA_LAUNCHED("copy_rows");
    }
    if (!model.has_last_step) return;
    copy_rows<<<blocks, kRowBlock, 0, stream>>>(num_rows, to, n, space.from, 1, model.last_step.get());
    GS_CUDA_LAUNCHED("copy_rows");
}

}  // namespace

DensifyStats CudaDensify::mcmc(const McmcParams& params, std::int64_t iteration, std::int64_t step,
                               std::uint64_t seed) {
    DensifyStats stats;
    const std::int64_t n = model_.count;
    model_.has_statistic = false;  // the statistic belongs to other rows (docs/math/densification.md#mcmc)
    if (n == 0) return stats;
    CudaResidualHandles residuals(model_, stream_);
    const std::int64_t target = mcmc_target(n, params);
    const IsDead is_dead{shown_opacities(model_), model_.param[int(Group::kRotation)].get(), logit(params.min_opacity)};
    McmcSpace space;
    CubSpace cub;
    const auto select = [&](void* m, std::size_t& b) {
        return select_rows(m, b, n, is_dead, space.dead, space.num_dead, stream_);
    };
    const auto scan_of = [&](auto weight) {
        return [&, weights = thrust::make_transform_iterator(row_indices(), weight)](void* m, std::size_t& b) {
            return cub::DeviceScan::InclusiveSum(m, b, weights, space.sums, n, stream_);
        };
    };
    const auto scan_living = scan_of(LivingWeight{is_dead});
    const auto scan_growth = scan_of(
        GrowthWeight{is_dead.opacities.raw_opacities, params.by_gradient ? model_.v[int(Group::kBase)].get() : nullptr,
                     model_.has_last_step ? model_.last_step.get() : nullptr, double(step)});
    cub.ask(select), cub.ask(scan_living), cub.ask(scan_growth);
    scratch_.carve([&](Carver& c) {
        space = {c.take<std::uint64_t>(n), c.take<int>(n), c.take<std::uint32_t>(n),
                 c.take<std::uint32_t>(std::max(n, target - n)), c.take<std::int64_t>(1)};
        cub.take(c);
    });

    cub.run(select), cub.run(scan_living);
    const std::int64_t num_dead = read_back(space.num_dead, stream_);
    if (num_dead > 0 && num_dead < n && read_back(space.sums + n - 1, stream_) > 0) {
        fill_rows(model_, space, n, {num_dead, space.dead, RngStream::kRelocate}, params.min_opacity, iteration, seed,
                  stream_);
        stats.relocated = num_dead;
    }

    if (target > n) {
        cub.run(scan_growth);
        if (read_back(space.sums + n - 1, stream_) > 0) {
            // Only once; no kernel uses the old rows any more.
            model_.reserve_rows(std::max(params.cap, params.room));
            for (int g = 0; g < kNumGroups; ++g)
                for (auto* moment : model_.moments(g))
                    if (const int width = model_.width[g])
                        GS_CUDA(cudaMemsetAsync(moment->get() + n * width, 0,
                                                std::size_t(target - n) * width * sizeof(float), stream_));
            fill_rows(model_, space, n, {target - n, nullptr, RngStream::kGrow}, params.min_opacity, iteration, seed,
                      stream_);
            model_.count = target;
            stats.added = target - n;
        }
    }
    GS_CUDA(cudaStreamSynchronize(stream_));
    residuals.resolve(scratch_);
    stats.count = model_.count;
    return stats;
}

}  // namespace gs
