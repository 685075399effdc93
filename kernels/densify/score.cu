// SPDX-License-Identifier: Apache-2.0
// Pruning by score on the device.
#include <cub/device/device_radix_sort.cuh>

#include "kernels/densify/densify_cuda.h"
#include "kernels/densify/rows_cuda.h"
#include "kernels/densify/score_rule.h"

namespace gs {
namespace {

__global__ void list_rows(std::int64_t n, std::uint32_t* rows) {
    const std::int64_t i = thread_row();
    if (i < n) rows[i] = std::uint32_t(i);
}

/// Finds the cut in one thread. `scores` fall; the threshold is the score of rank `rank` from below.
__global__ void find_cut(std::int64_t n, std::int64_t rank, std::int64_t least, const float* scores,
                         const std::uint32_t* rows, ScoreCut* cut) {
    const float threshold = scores[n - rank];
    std::int64_t low = 0, high = n;  // bisects for the first score that is not above the threshold
    while (low < high) {
        const std::int64_t middle = (low + high) / 2;
        if (scores[middle] > threshold)
            low = middle + 1;
        else
            high = middle;
    }
    const std::int64_t last = (low > least ? low : least) - 1;
    *cut = {scores[last], rows[last]};
}

__global__ void mark_cut_rows(std::int64_t n, ScoreCut cut, const float* scores, unsigned char* marked) {
    const std::int64_t i = thread_row();
    if (i < n) marked[i] = !cut.keeps(scores[i], std::uint32_t(i));
}

}  // namespace

std::int64_t CudaDensify::prune_lowest_scores(const float* scores, double ratio) {
    const std::int64_t n = model_.count;
    if (n == 0) return 0;
    const unsigned blocks = num_blocks(n, kRowBlock);
    float* sorted = nullptr;
    std::uint32_t *rows = nullptr, *sorted_rows = nullptr;
    ScoreCut* cut = nullptr;
    CubSpace cub;
    const auto sort = [&](void* m, std::size_t& b) {
        return cub::DeviceRadixSort::SortPairsDescending(m, b, scores, sorted, rows, sorted_rows, n, 0, 32, stream_);
    };
    cub.ask(sort);
    scratch_.carve([&](Carver& c) {
        sorted = c.take<float>(n), rows = c.take<std::uint32_t>(n), sorted_rows = c.take<std::uint32_t>(n),
        cut = c.take<ScoreCut>(1);
        cub.take(c);
    });
    list_rows<<<blocks, kRowBlock, 0, stream_>>>(n, rows);
    GS_CUDA_LAUNCHED("list_rows");
    cub.run(sort);  // stable: equal scores stay in the order of their rows
    find_cut<<<1, 1, 0, stream_>>>(n, score_rank(ratio, n), least_kept(n), sorted, sorted_rows, cut);
    GS_CUDA_LAUNCHED("find_cut");
    const ScoreCut found = read_back(cut, stream_);

    PruneSpace space(model_, scratch_, stream_);
    mark_cut_rows<<<blocks, kRowBlock, 0, stream_>>>(n, found, scores, space.marked);
    GS_CUDA_LAUNCHED("mark_cut_rows");
    return space.remove_marked();
}

}  // namespace gs
