// SPDX-License-Identifier: Apache-2.0
// Adaptive density control on the device. It first decides the fate of every row; then a single gather builds the new
// model.
#include <cub/device/device_radix_sort.cuh>

#include "kernels/densify/adc_device.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/densify_cuda.h"
#include "kernels/densify/rows_cuda.h"

namespace gs {
namespace {

/// The fate of a row; several flags may be set.
enum Fate : unsigned char { kGrows = 1, kOriginalStays = 2, kCloneStays = 4, kChildrenStay = 8 };

struct HasFate {
    const unsigned char* fates;
    unsigned char wanted;
    __host__ __device__ bool operator()(std::uint32_t i) const { return fates[i] & wanted; }
};

struct AdcCounts {
    unsigned long long cloned, split, originals, clones, parents;  ///< the last three count only rows that stay
};

/// Marks the rows that grow. Without a statistic all sums count as zero.
__global__ void find_growers(std::int64_t n, AdcRule rule, const float* gradient_sum, const float* gradient_count,
                             unsigned char* fates) {
    const std::int64_t i = thread_row();
    if (i < n)
        fates[i] =
            rule.grows(gradient_sum ? gradient_sum[i] : 0.0f, gradient_count ? gradient_count[i] : 0.0f) ? kGrows : 0;
}

__global__ void rank_growers(std::int64_t n, const std::uint32_t* growers, const float* gradient_sum,
                             const float* gradient_count, float* ranks) {
    const std::int64_t k = thread_row();
    if (k >= n) return;
    const std::uint32_t i = growers[k];
    ranks[k] = adc_rank(gradient_sum ? gradient_sum[i] : 0.0f, gradient_count ? gradient_count[i] : 0.0f);
}

__global__ void drop_growers(std::int64_t n, const std::uint32_t* growers, unsigned char* fates) {
    const std::int64_t k = thread_row();
    if (k < n) fates[growers[k]] = 0;
}

__device__ void count_in_block(bool condition, unsigned long long* counter) {
    const int n = __syncthreads_count(condition);
    if (threadIdx.x == 0 && n > 0) atomicAdd(counter, static_cast<unsigned long long>(n));
}

__global__ void decide_fates(std::int64_t n, AdcRule rule, ShownOpacities opacities, const float* rotations,
                             const float* log_scales, unsigned char* fates, AdcCounts* counts) {
    const std::int64_t i = thread_row();
    bool cloned = false, split = false;
    unsigned char fate = 0;
    if (i < n) {  // all threads of the block take part in counting
        const float scale = max_log_scale(log_scales + 3 * i);
        const bool grows = fates[i] & kGrows;
        cloned = grows && rule.is_small(scale), split = grows && !cloned;
        // A clone equals its original, and both children have the same scale, so one test decides for both.
        const float shift = split ? -kLogSplitShrink : 0.0f;
        if (rule.is_kept(opacities(i, shift), rotations + 4 * i, scale + shift)) {
            fate = split ? kChildrenStay : kOriginalStays;
            if (cloned) fate |= kCloneStays;
        }
        fates[i] = fate;
    }
    count_in_block(cloned, &counts->cloned);
    count_in_block(split, &counts->split);
    count_in_block(fate & kOriginalStays, &counts->originals);
    count_in_block(fate & kCloneStays, &counts->clones);
    count_in_block(fate & kChildrenStay, &counts->parents);
}

__global__ void list_children(std::int64_t n, const std::uint32_t* parents, std::uint32_t* order) {
    const std::int64_t k = thread_row();
    if (k < n) order[k] = parents[k / 2];
}

/// Converts the rows from `first` on, which are two copies of each parent, to children.
__global__ void make_children(std::int64_t n, std::int64_t first, const std::uint32_t* order, float* means,
                              float* log_scales, const float* rotations, std::int64_t iteration, std::uint64_t seed) {
    const std::int64_t k = thread_row(), row = first + k;
    if (k < n)
        make_split_child(means + 3 * row, log_scales + 3 * row, rotations + 4 * row, order[row], std::uint32_t(k & 1),
                         iteration, seed);
}

__global__ void cap_opacities(std::int64_t n, float* raw_opacities) {
    const std::int64_t i = thread_row();
    if (i < n) raw_opacities[i] = reset_raw_opacity(raw_opacities[i]);
}

bool has_room(CudaModel& model, std::int64_t rows) {
    for (int g = 0; g < kNumGroups; ++g) {
        const std::size_t floats = std::size_t(rows) * model.width[g];
        if (model.param[g].capacity() < floats) return false;
        for (const auto* moment : model.moments(g))
            if (moment->capacity() < floats) return false;
    }
    return !model.has_last_step || model.last_step.capacity() >= std::size_t(rows);
}

struct AdcSpace {
    unsigned char* fates = nullptr;
    AdcCounts* counts = nullptr;
    std::int64_t* num_selected = nullptr;
    std::uint32_t* growers[2] = {};  ///< growers and ranks exist only with a cap
    float* ranks[2] = {};
    std::uint32_t *order = nullptr, *parents = nullptr;  ///< in the memory of growers and ranks
    CubSpace cub;
    RowSlice slice;

    /// Takes memory for the rows of `model`, of which at most `room` grow. `block`: size of the scratch in bytes before
    /// carving.
    void take(Carver& c, const CudaModel& model, std::int64_t room, bool capped, std::int64_t block) {
        const std::int64_t n = model.count;
        fates = c.take<unsigned char>(n), counts = c.take<AdcCounts>(1), num_selected = c.take<std::int64_t>(1);
        cub.take(c);
        const std::size_t ranked = c.at();
        for (auto& half : growers) half = c.take<std::uint32_t>(capped ? n : 0);
        for (auto& half : ranks) half = c.take<float>(capped ? n : 0);
        c.rewind(ranked);
        order = c.take<std::uint32_t>(n + room), parents = c.take<std::uint32_t>(room);
        slice = take_slice(c, model, n + room, block);
    }
};

/// Makes room for `total` rows, and for some more up to the cap (0: no cap), so that the next densification needs no
/// new memory.
void make_room(CudaModel& model, std::int64_t total, std::int64_t cap, cudaStream_t stream) {
    if (has_room(model, total)) return;
    GS_CUDA(cudaStreamSynchronize(stream));
    const std::int64_t spare = total + total / 20;
    model.reserve_rows(cap > 0 ? std::max(total, std::min(spare, cap)) : spare);
}

}  // namespace

DensifyStats CudaDensify::adc(const AdcParams& params, std::int64_t iteration, std::uint64_t seed) {
    const std::int64_t n = model_.count, block = scratch_.bytes();
    const bool capped = params.cap > 0;
    CudaResidualHandles residuals(model_, stream_);
    // Each clone or split adds one Gaussian. At the cap the strongest gradients grow first.
    const std::int64_t room = capped ? std::clamp<std::int64_t>(params.cap - n, 0, n) : n;
    const AdcRule rule = AdcRule::of(params);
    const float* sums = model_.has_statistic ? model_.gradient_sum.get() : nullptr;
    const float* views = model_.has_statistic ? model_.gradient_count.get() : nullptr;
    const auto param = [&](Group g) { return model_.param[int(g)].get(); };
    AdcSpace space;
    AdcCounts counts{};
    if (n > 0) {
        HasFate wanted{};
        std::uint32_t* selected = nullptr;
        std::int64_t num_growers = n;
        cub::DoubleBuffer<float> keys;
        cub::DoubleBuffer<std::uint32_t> rows;
        const auto select = [&](void* m, std::size_t& b) {
            return select_rows(m, b, n, wanted, selected, space.num_selected, stream_);
        };
        const auto sort = [&](void* m, std::size_t& b) {
            return cub::DeviceRadixSort::SortPairs(m, b, keys, rows, num_growers, 0, 32, stream_);
        };
        space.cub.ask(select);
        if (capped) space.cub.ask(sort);
        scratch_.carve([&](Carver& c) { space.take(c, model_, room, capped, block); });
        const auto list = [&](Fate fate, std::uint32_t* out) {
            wanted = {space.fates, fate}, selected = out;
            space.cub.run(select);
        };
        const unsigned blocks = num_blocks(n, kRowBlock);
        find_growers<<<blocks, kRowBlock, 0, stream_>>>(n, rule, sums, views, space.fates);
        GS_CUDA_LAUNCHED("find_growers");
        if (capped) {
            list(kGrows, space.growers[0]);
            num_growers = read_back(space.num_selected, stream_);
            if (num_growers > room) {
                rank_growers<<<num_blocks(num_growers, kRowBlock), kRowBlock, 0, stream_>>>(
                    num_growers, space.growers[0], sums, views, space.ranks[0]);
                GS_CUDA_LAUNCHED("rank_growers");
                keys = {space.ranks[0], space.ranks[1]}, rows = {space.growers[0], space.growers[1]};
                space.cub.run(sort);  // stable: among equal ranks the first rows grow
                const std::int64_t dropped = num_growers - room;
                drop_growers<<<num_blocks(dropped, kRowBlock), kRowBlock, 0, stream_>>>(dropped, rows.Current() + room,
                                                                                        space.fates);
                GS_CUDA_LAUNCHED("drop_growers");
            }
        }
        GS_CUDA(cudaMemsetAsync(space.counts, 0, sizeof counts, stream_));
        decide_fates<<<blocks, kRowBlock, 0, stream_>>>(n, rule, shown_opacities(model_), param(Group::kRotation),
                                                        param(Group::kScale), space.fates, space.counts);
        GS_CUDA_LAUNCHED("decide_fates");
        counts = read_back(space.counts, stream_);
        list(kOriginalStays, space.order);
        list(kCloneStays, space.order + counts.originals);
        list(kChildrenStay, space.parents);
    }
    const auto kept = std::int64_t(counts.originals), children = 2 * std::int64_t(counts.parents),
               first_child = kept + std::int64_t(counts.clones);
    const std::int64_t total = first_child + children,
                       before_pruning = n + std::int64_t(counts.cloned) + 2 * std::int64_t(counts.split);
    if (total == 0 && !params.may_remove_all) throw_nothing_left(params, iteration, before_pruning);
    if (children > 0) {
        list_children<<<num_blocks(children, kRowBlock), kRowBlock, 0, stream_>>>(children, space.parents,
                                                                                  space.order + first_child);
        GS_CUDA_LAUNCHED("list_children");
    }
    make_room(model_, total, params.cap, stream_);
    model_.has_statistic = false;  // it restarts
    gather_rows(model_, space.order, kept, total, space.slice, stream_);
    if (children > 0) {
        make_children<<<num_blocks(children, kRowBlock), kRowBlock, 0, stream_>>>(
            children, first_child, space.order, param(Group::kMean), param(Group::kScale), param(Group::kRotation),
            iteration, seed);
        GS_CUDA_LAUNCHED("make_children");
    }
    GS_CUDA(cudaStreamSynchronize(stream_));
    residuals.resolve(scratch_);
    DensifyStats stats;
    stats.cloned = std::int64_t(counts.cloned), stats.split = std::int64_t(counts.split);
    stats.pruned = before_pruning - stats.split - total;
    stats.count = total;
    return stats;
}

void CudaDensify::reset_opacity() {
    const std::int64_t n = model_.count;
    const int g = int(Group::kOpacity);
    if (n == 0) return;
    cap_opacities<<<num_blocks(n, kRowBlock), kRowBlock, 0, stream_>>>(n, model_.param[g].get());
    GS_CUDA_LAUNCHED("cap_opacities");
    for (auto* moment : {&model_.m[g], &model_.v[g]})
        GS_CUDA(cudaMemsetAsync(moment->get(), 0, model_.floats(g) * sizeof(float), stream_));
    GS_CUDA(cudaStreamSynchronize(stream_));
}

}  // namespace gs
