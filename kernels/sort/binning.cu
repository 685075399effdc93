// SPDX-License-Identifier: Apache-2.0
// Radix sorts of Gaussians by depth and of their instances by tile.
#include "kernels/sort/binning_cuda.h"
#include "kernels/sort/radix_cuda.cuh"

namespace gs {
namespace {

constexpr int kBlock = 256, kWriteBlock = 256, kWriteItems = ChunkSums::kPairs / kWriteBlock;
constexpr unsigned kManyBlocks = 512;  ///< enough to fill a large device once

/// Input and output of writing instances.
template <class Key> struct InstanceLists {
    std::uint32_t n, room;
    const std::uint32_t* order;   ///< visible Gaussians, front to back
    const std::uint32_t* counts;  ///< (n)
    const TileSpan* spans;        ///< (n)
    Key* tile_keys;               ///< (room)
    std::uint32_t* instances;     ///< (room) Gaussian of each instance
    std::uint32_t* ends;          ///< (n) end of each Gaussian's instances, in depth order; or null
    /// (n) Gaussians with more than 32 candidate tiles, and the first instance of each: large Gaussians fill the array
    /// from its beginning, huge ones from its end.
    uint2* large;
    std::uint32_t* counts_of_digits;  ///< number of tile keys with each digit, initially 0
    DigitPlan plan;
    ChunkSums sums;  ///< the number of instances of each block's Gaussians
};

/// A large Gaussian is huge if it has more than kHuge instances. Some cover the image, and a single warp would still
/// write one when all others are done; so kHugeParts warps share it.
constexpr std::uint32_t kHuge = 256, kHugeParts = 8;

/// Counts the digits of a block's keys in its shared memory. All threads of the block must call clear() and add_to().
template <int kThreads> struct DigitCounts {
    std::uint32_t* counts;
    DigitPlan plan;

    __device__ void clear() const {
        for (int c = int(threadIdx.x); c < plan.counts(); c += kThreads) counts[c] = 0;
        __syncthreads();
    }
    __device__ void count(std::uint32_t key) const {
        for (int p = 0; p < plan.passes; ++p)
            atomicAdd(&counts[p << plan.bits | (key >> p * plan.bits & ((1u << plan.bits) - 1))], 1u);
    }
    __device__ void add_to(std::uint32_t* all) const {
        __syncthreads();
        for (int c = int(threadIdx.x); c < plan.counts(); c += kThreads)
            if (counts[c]) atomicAdd(&all[c], counts[c]);
    }
};
constexpr int kMostCounts = 4 * 256;  ///< four passes by 8 bits

/// Writes the instances of a block's Gaussians in depth order. Gaussians with more than 32 candidate tiles, which tend
/// to be adjacent in depth order, are left to write_large_instances.
template <class Key>
__global__ void __launch_bounds__(kWriteBlock, 5)  // so that 0.3 M Gaussians are processed at once
    write_instances(InstanceLists<Key> lists, int tiles_x, StepControl* control) {
    constexpr int kWarps = kWriteBlock / 32;
    __shared__ std::uint32_t digit_counts[kMostCounts], before, warp_sums[kWarps];
    __shared__ std::uint16_t candidates[kWarps][32 * 32];  // lane and candidate tile of 32 Gaussians' instances
    const std::uint32_t num_visible = control->num_visible, lane = threadIdx.x & 31, warp = threadIdx.x / 32,
                        first = blockIdx.x * ChunkSums::kPairs + warp * (32 * kWriteItems) + lane;
    if (control->num_instances > lists.room) {
        if (first == 0) control->stopped = 1;
        return;
    }
    if (blockIdx.x * ChunkSums::kPairs >= num_visible) {  // no block needs this block's sum
        for (std::uint32_t k = first; lists.ends && k < min(first + 32 * kWriteItems, lists.n); k += 32)
            lists.ends[k] = std::uint32_t(control->num_instances);
        return;
    }
    const auto is_visible = [&](int u) { return first + 32 * u < num_visible; };
    std::uint32_t gaussian[kWriteItems], count[kWriteItems], start[kWriteItems];
    TileSpan span[kWriteItems];
#pragma unroll
    for (int u = 0; u < kWriteItems; ++u) gaussian[u] = is_visible(u) ? lists.order[first + 32 * u] : 0;
#pragma unroll
    for (int u = 0; u < kWriteItems; ++u) span[u] = is_visible(u) ? lists.spans[gaussian[u]] : TileSpan{0, 0};
    const std::uint32_t group = blockIdx.x / ChunkSums::kChunksOfGroup,
                        in_group = blockIdx.x % ChunkSums::kChunksOfGroup;
    std::uint32_t sum_before = threadIdx.x < in_group ? lists.sums.of_chunks[blockIdx.x - in_group + threadIdx.x] : 0;
    for (std::uint32_t g = threadIdx.x; g < group; g += kWriteBlock) sum_before += lists.sums.of_groups[g];
    const DigitCounts<kWriteBlock> digits{digit_counts, lists.plan};
    if (threadIdx.x == 0) before = 0;
    digits.clear();
    sum_before = __reduce_add_sync(~0u, sum_before);
    if (lane == 0 && sum_before > 0) atomicAdd(&before, sum_before);

    const auto is_small = [&](int u) { return span[u].width() > 0; };  // false past the last Gaussian, too
    std::uint32_t of_warp = 0;
#pragma unroll
    for (int u = 0; u < kWriteItems; ++u) {
        count[u] = is_small(u) ? __popc(span[u].mask) : is_visible(u) ? lists.counts[gaussian[u]] : 0;
        const std::uint32_t up_to = inclusive_sum(count[u]);
        start[u] = of_warp + up_to - count[u];
        of_warp += __shfl_sync(~0u, up_to, 31);
    }
    if (lane == 0) warp_sums[warp] = of_warp;
    __syncthreads();
    std::uint32_t before_warp = before;
    for (std::uint32_t w = 0; w < warp; ++w) before_warp += warp_sums[w];

    // Lanes have different numbers of instances: the warp lists all of them, and then each lane writes every 32nd.
    std::uint16_t* list = candidates[warp];
#pragma unroll
    for (int u = 0; u < kWriteItems; ++u) {
        start[u] += before_warp;
        const std::uint32_t k = first + 32 * u;
        if (lists.ends && k < lists.n) lists.ends[k] = start[u] + count[u];
        if (is_visible(u) && !is_small(u))
            lists.large[count[u] > kHuge ? lists.n - 1 - atomicAdd(&control->num_huge, 1u)
                                         : atomicAdd(&control->num_large, 1u)] = make_uint2(gaussian[u], start[u]);
        const std::uint32_t own = is_small(u) ? count[u] : 0, end = inclusive_sum(own),
                            total = __shfl_sync(~0u, end, 31);
        std::uint32_t at = end - own;
        if (is_small(u))
            for (unsigned bits = span[u].mask; bits; bits &= bits - 1)
                list[at++] = std::uint16_t(lane << 5 | (__ffs(bits) - 1));
        __syncwarp();
        const std::uint32_t place_to_instance = start[u] - (end - own);
        for (std::uint32_t place = lane; place - lane < total; place += 32) {
            const std::uint32_t word = place < total ? list[place] : 0, owner = word >> 5;
            const TileSpan tiles{__shfl_sync(~0u, span[u].where, owner), 0};
            const std::uint32_t g = __shfl_sync(~0u, gaussian[u], owner),
                                i = place + __shfl_sync(~0u, place_to_instance, owner);
            if (place >= total) continue;
            // The added half keeps the quotient away from integers, which rounding could cross.
            const int candidate = word & 31, row = int((candidate + 0.5f) / tiles.width());
            const int column = tiles.x0() + candidate - row * tiles.width();
            const Key key = Key((tiles.y0() + row) * tiles_x + (column >= tiles_x ? column - tiles_x : column));
            lists.tile_keys[i] = key;
            lists.instances[i] = g;
            digits.count(key);
        }
        __syncwarp();  // before the list is overwritten
    }
    digits.add_to(lists.counts_of_digits);
}

/// Writes the instances of large and huge Gaussians, 32 at a time. A warp processes one large Gaussian, or every
/// kHugeParts-th 32 instances of a huge one.
template <class Key>
__global__ void __launch_bounds__(kBlock)
    write_large_instances(InstanceLists<Key> lists, const PackedSplat* __restrict__ splats, int tiles_x,
                          const StepControl* __restrict__ control) {
    __shared__ std::uint32_t digit_counts[kMostCounts];
    const std::uint32_t of_huge = control->num_huge * kHugeParts, num_items = of_huge + control->num_large;
    if (control->num_instances > lists.room || blockIdx.x * (kBlock / 32) >= num_items) return;
    const DigitCounts<kBlock> digits{digit_counts, lists.plan};
    digits.clear();
    const std::uint32_t lane = threadIdx.x & 31;
    for (std::uint32_t item = (blockIdx.x * kBlock + threadIdx.x) / 32; item < num_items;
         item += gridDim.x * kBlock / 32) {
        const bool is_huge = item < of_huge;
        const std::uint32_t parts = is_huge ? kHugeParts : 1, part = is_huge ? item % kHugeParts : 0;
        const uint2 own = lists.large[is_huge ? lists.n - 1 - item / kHugeParts : item - of_huge];
        const std::uint32_t gaussian = own.x, stop = own.y + lists.counts[gaussian];
        std::uint32_t at = own.y;
        const PackedSplat s = splats[gaussian];
        const TileRectangle r(s.bounds());
        for (int y = r.y0; y < r.y0 + r.height; y += 32) {
            // Each lane has a row of tiles; the instances of 32 rows are contiguous.
            const TileRows::Span mine = span_of_lane(s, y, r.y0 + r.height, tiles_x);
            const std::uint32_t size = std::uint32_t(mine.size()), end = inclusive_sum(size),
                                total = __shfl_sync(~0u, end, 31),
                                key_before = std::uint32_t((y + int(lane)) * tiles_x + mine.x0) - (end - size);
            for (std::uint32_t place = part * 32 + lane; place - lane < total; place += parts * 32) {
                std::uint32_t row = 0;  // the first row that ends after this place
#pragma unroll
                for (std::uint32_t step = 16; step > 0; step /= 2)
                    if (__shfl_sync(~0u, end, row + step - 1) <= place) row += step;
                std::uint32_t tile = __shfl_sync(~0u, key_before, row) + place;
                if (tile >= std::uint32_t((y + int(row) + 1) * tiles_x)) tile -= tiles_x;  // beyond the seam
                const Key key = Key(tile);
                if (place >= total || at + place >= stop) continue;
                lists.tile_keys[at + place] = key;
                lists.instances[at + place] = gaussian;
                digits.count(key);
            }
            at += total;
        }
    }
    digits.add_to(lists.counts_of_digits);
}

/// Returns the maximum of x over this lane and all later lanes.
__device__ std::uint32_t suffix_max(std::uint32_t x) {
#pragma unroll
    for (int d = 1; d < 32; d *= 2) x = max(x, __shfl_down_sync(~0u, x, d));  // beyond the warp: the lane's own
    return x;
}

/// Sets offsets[t] to the first instance of a tile >= t, and lists the work items on tiles by estimated time, in steps
/// of 16 instances, with a counting sort. One block does this. Its threads have five tiles in each step, so that one
/// step covers 1280x720. With eight, half of the threads would have no tile of an 800x800 image, and the others would
/// take longer. All other blocks set `to_clear` to 0.
constexpr int kOrderThreads = 1024, kLengths = 256, kTilesOfThread = 5;
__global__ void __launch_bounds__(kOrderThreads)
    order_tiles(NumPairs num_instances, KeyBegins begins, std::uint32_t num_items, std::uint32_t* __restrict__ offsets,
                TileItem* __restrict__ longest_first, std::span<uint4> to_clear) {
    if (blockIdx.x > 0) {
        for (std::size_t k = std::size_t(blockIdx.x - 1) * kOrderThreads + threadIdx.x; k < to_clear.size();
             k += std::size_t(gridDim.x - 1) * kOrderThreads)
            to_clear[k] = {};
        return;
    }
    constexpr std::uint32_t kWarps = kOrderThreads / 32, kStep = kOrderThreads * kTilesOfThread, kShortest = 256;
    __shared__ std::uint32_t place[kLengths], listed, from_warp[kWarps + 1];
    const std::uint32_t n = num_instances(), num_tiles = begins.most, lane = threadIdx.x & 31, warp = threadIdx.x / 32,
                        limit = max(n / kMostQuartered, kShortest);  // a shorter list is not worth three more blocks
    const auto bin = [&](std::uint32_t length) {
        return kLengths - 1 - min((length > limit ? length / 2 : length) / 16, std::uint32_t(kLengths - 1));
    };
    // Adds a list to its bin, and returns the bin's previous value. The first use only counts; once bins hold places,
    // the value is the place of the list. Lanes with the shortest lists, e.g. of empty tiles, share one atomic.
    const auto put = [&](bool is_tile, std::uint32_t length) {
        const bool is_shortest = is_tile && bin(length) == kLengths - 1;
        const unsigned shortest = __ballot_sync(~0u, is_shortest), before = shortest & ((1u << lane) - 1);
        std::uint32_t at = 0;
        if (is_shortest ? !before : is_tile)
            at = atomicAdd(&place[bin(length)], is_shortest ? __popc(shortest) : length > limit ? 4u : 1u);
        const std::uint32_t of_first = __shfl_sync(~0u, at, shortest ? __ffs(shortest) - 1 : 0);
        return is_shortest ? of_first + __popc(before) : at;
    };
    if (threadIdx.x < kLengths) place[threadIdx.x] = 0;
    if (threadIdx.x == 0) from_warp[kWarps] = max(begins.words[num_tiles], ~n), offsets[num_tiles] = ~from_warp[kWarps];

    // From the last tiles to the first; the tiles of a thread are adjacent. Words are ~ of places, so that the largest
    // is the first instance.
    for (std::uint32_t step = (num_tiles + kStep - 1) / kStep; step-- > 0;) {
        const std::uint32_t first = step * kStep + threadIdx.x * kTilesOfThread;
        std::uint32_t word[kTilesOfThread + 1];
#pragma unroll
        for (int u = 0; u < kTilesOfThread; ++u) word[u] = first + u < num_tiles ? begins.words[first + u] : 0;
#pragma unroll
        for (int u = kTilesOfThread - 2; u >= 0; --u) word[u] = max(word[u], word[u + 1]);
        const std::uint32_t of_lanes = suffix_max(word[0]);
        __syncthreads();  // from_warp[kWarps] is valid, and the other values are no longer read
        const std::uint32_t behind_step = from_warp[kWarps];
        if (lane == 0) from_warp[warp] = of_lanes;
        __syncthreads();
        const std::uint32_t other = suffix_max(lane > warp ? from_warp[lane] : 0),
                            next = __shfl_down_sync(~0u, of_lanes, 1);
        word[kTilesOfThread] = max(max(lane < 31 ? next : 0, __shfl_sync(~0u, other, 0)), behind_step);
#pragma unroll
        for (int u = 0; u < kTilesOfThread; ++u) {
            word[u] = max(word[u], word[kTilesOfThread]);
            if (first + u < num_tiles) offsets[first + u] = ~word[u];
        }
#pragma unroll
        for (int u = 0; u < kTilesOfThread; ++u) put(first + u < num_tiles, word[u] - word[u + 1]);
        __syncthreads();
        if (threadIdx.x == 0) from_warp[kWarps] = word[0];
    }
    __syncthreads();
    if (threadIdx.x < 32) {  // exclusive scan by one warp, eight bins a lane
        std::uint32_t own[kLengths / 32], sum = 0;
        for (int k = 0; k < kLengths / 32; ++k) own[k] = place[threadIdx.x * (kLengths / 32) + k], sum += own[k];
        std::uint32_t before = inclusive_sum(sum);
        if (threadIdx.x == 31) listed = before;
        before -= sum;
        for (int k = 0; k < kLengths / 32; ++k) place[threadIdx.x * (kLengths / 32) + k] = before, before += own[k];
    }
    __syncthreads();
    for (std::uint32_t first = threadIdx.x; first - threadIdx.x < num_tiles; first += kStep) {
        std::uint32_t begin[kTilesOfThread], end[kTilesOfThread];
#pragma unroll
        for (int u = 0; u < kTilesOfThread; ++u)
            if (const std::uint32_t t = first + u * kOrderThreads; t < num_tiles)
                begin[u] = offsets[t], end[u] = offsets[t + 1];
#pragma unroll
        for (int u = 0; u < kTilesOfThread; ++u) {
            const std::uint32_t t = first + u * kOrderThreads, length = t < num_tiles ? end[u] - begin[u] : 0,
                                at = put(t < num_tiles, length);
            if (t >= num_tiles) continue;
            if (length > limit)
                for (int k = 0; k < 4; ++k) longest_first[at + k] = TileItem::part(t, k);
            else
                longest_first[at] = TileItem::whole(t);
        }
    }
    for (std::uint32_t k = listed + threadIdx.x; k < num_items; k += kOrderThreads) longest_first[k] = {};
}

/// Smallest key of a Gaussian that touches a tile.
constexpr std::uint32_t kLeastVisible = 1u << kDepthKeyBits;

/// Counts the Gaussians that are not culled, their instances, and the digits of their depth keys. tiles: (n) touched
/// tiles of each Gaussian.
constexpr int kCountBlock = 512, kCountItems = 4;
__global__ void __launch_bounds__(kCountBlock)
    count_visible(std::uint32_t n, const std::uint32_t* __restrict__ keys, const std::uint32_t* __restrict__ tiles,
                  DigitPlan plan, std::uint32_t* counts, StepControl* control) {
    __shared__ std::uint32_t digit_counts[kMostCounts];
    __shared__ unsigned long long instances_of_block;
    __shared__ unsigned visible_of_block;
    unsigned long long instances = 0;
    unsigned visible = 0;
    if (threadIdx.x == 0) instances_of_block = 0, visible_of_block = 0;
    const DigitCounts<kCountBlock> digits{digit_counts, plan};
    digits.clear();
    constexpr std::uint32_t kStep = kCountBlock * kCountItems;
    for (std::uint32_t first = blockIdx.x * kStep + threadIdx.x; first - threadIdx.x < n; first += gridDim.x * kStep) {
        std::uint32_t key[kCountItems];
#pragma unroll
        for (int u = 0; u < kCountItems; ++u) key[u] = first + u * kCountBlock < n ? keys[first + u * kCountBlock] : 0;
#pragma unroll
        for (int u = 0; u < kCountItems; ++u) {
            if (key[u] < kLeastVisible) continue;
            digits.count(key[u]);
            const std::uint32_t touched = key[u] >> kDepthKeyBits;
            instances += touched == kManyTiles ? tiles[first + u * kCountBlock] : touched;
            ++visible;
        }
    }
    visible = __reduce_add_sync(~0u, visible);
#pragma unroll
    for (int d = 16; d > 0; d /= 2) instances += __shfl_xor_sync(~0u, instances, d);
    if (threadIdx.x % 32 == 0) atomicAdd(&instances_of_block, instances), atomicAdd(&visible_of_block, visible);
    digits.add_to(counts);  // begins with a barrier
    if (threadIdx.x == 0 && visible_of_block > 0) {
        atomicAdd(&control->num_instances, instances_of_block);
        atomicAdd(&control->num_visible, visible_of_block);
    }
}

constexpr DigitPlan kDepthPlan = DigitPlan::of(kDepthKeyBits);

}  // namespace

DigitPlan CudaBinning::tile_plan() const {
    int bits = 1;
    while ((std::int64_t(1) << bits) < bins_.num_tiles()) ++bits;
    return DigitPlan::of(bits);
}

void CudaBinning::take_results(Carver& c, std::int64_t n, std::int64_t capacity, int width, int height,
                               bool keep_slots) {
    n_ = n, capacity_ = capacity, keep_slots_ = keep_slots;
    bins_.tiles_x = (width + kCudaTileX - 1) / kCudaTileX;
    bins_.tiles_y = (height + kCudaTileY - 1) / kCudaTileY;
    input_.zeros = {};
    const std::size_t fours = counts_for(capacity).words / 4;
    input_.zeros = {c.take<uint4>(fours), fours};
    input_.counts = c.take<std::uint32_t>(n);
    sorted_ = c.take<std::uint32_t>(capacity);
    tile_offsets_ = c.take<std::uint32_t>(bins_.num_tiles() + 1);
    longest_first_ = c.take<TileItem>(bins_.num_items());
    ends_ = nullptr;
    if (!keep_slots) return;
    order_ = c.take<std::uint32_t>(n);
    ends_ = c.take<std::uint32_t>(n);
    gaussians_ = c.take<std::uint32_t>(capacity);
}

std::size_t CudaBinning::take_temporaries(Carver& c) {
    input_.depth_keys = c.take<std::uint32_t>(n_);
    input_.spans = c.take<TileSpan>(n_);
    const std::size_t end_of_input = c.at();
    large_ = c.take<uint2>(n_);
    if (!keep_slots_) order_ = c.take<std::uint32_t>(n_);
    const DigitPlan tiles = tile_plan();
    const std::size_t key_words = tiles.passes == 2 ? (capacity_ + 1) / 2 : capacity_;
    for (std::uint32_t*& keys : tile_keys_) keys = c.take<std::uint32_t>(key_words);
    other_ = c.take<std::uint32_t>(capacity_);
    return end_of_input;
}

/// Returns the places of the counters and sums for a sort of `instances` instances.
CudaBinning::Counts CudaBinning::counts_for(std::int64_t instances) const {
    auto* const zeros = reinterpret_cast<std::uint32_t*>(input_.zeros.data());
    Counts c;
    const auto take = [&](std::size_t words) {
        std::uint32_t* const taken = zeros ? zeros + c.words : nullptr;
        c.words += (words + 3) / 4 * 4;  // so that groups of four are aligned
        return taken;
    };
    const DigitPlan tiles = tile_plan();
    const unsigned groups = num_blocks(n_, ChunkSums::kPairs * ChunkSums::kChunksOfGroup);
    c.depth_digits = take(kDepthPlan.counts()), c.tile_digits = take(tiles.counts());
    c.chunk_sums = {input_.counts, take(groups * ChunkSums::kChunksOfGroup), take(groups)};
    c.tile_begins = take(bins_.num_tiles() + 1);
    c.depth_sums = take(kDepthPlan.passes * kDepthPlan.sums(n_));
    c.tile_sums = take(tiles.passes * tiles.sums(instances));
    return c;
}

template <class Key>
void CudaBinning::sort_instances(const PackedSplat* splats, std::int64_t room, std::span<uint4> to_clear,
                                 StepControl* control, const Counts& counts, cudaStream_t stream) {
    const DigitPlan plan = tile_plan();
    // The last pass writes the sorted instances.
    std::uint32_t *unsorted = plan.passes % 2 ? other_ : sorted_, *behind = plan.passes % 2 ? sorted_ : other_;
    const RadixPairs<Key> pairs{{reinterpret_cast<Key*>(tile_keys_[0]), reinterpret_cast<Key*>(tile_keys_[1])},
                                {unsorted, behind}};
    const InstanceLists<Key> lists{std::uint32_t(n_),
                                   std::uint32_t(room),
                                   order_,
                                   input_.counts,
                                   input_.spans,
                                   pairs.keys[0],
                                   keep_slots_ ? gaussians_ : unsorted,
                                   ends_,
                                   large_,
                                   counts.tile_digits,
                                   plan,
                                   counts.chunk_sums};
    const KeyBegins begins{counts.tile_begins, std::uint32_t(bins_.num_tiles())};
    const NumPairs num_instances{NumPairs::kInstances, std::uint32_t(room), control};
    if (n_ > 0) {
        write_instances<Key>
            <<<num_blocks(n_, ChunkSums::kPairs), kWriteBlock, 0, stream>>>(lists, bins_.tiles_x, control);
        GS_CUDA_LAUNCHED("write_instances");
        write_large_instances<Key><<<kManyBlocks, kBlock, 0, stream>>>(lists, splats, bins_.tiles_x, control);
        GS_CUDA_LAUNCHED("write_large_instances");
        sort_pairs(plan, pairs, keep_slots_, counts.tile_digits, counts.tile_sums, num_instances, num_instances,
                   {.begins = begins}, stream);
    }
    const unsigned clearing = std::min(num_blocks(std::int64_t(to_clear.size()), 4 * kOrderThreads), kManyBlocks);
    order_tiles<<<1 + clearing, kOrderThreads, 0, stream>>>(num_instances, begins, bins_.num_items(), tile_offsets_,
                                                            longest_first_, to_clear);
    GS_CUDA_LAUNCHED("order_tiles");
}

CudaBins CudaBinning::build(const PackedSplat* splats, std::int64_t room, std::span<uint4> to_clear,
                            StepControl* control, cudaStream_t stream) {
    const Counts counts = counts_for(room);
    if (n_ == 0) {  // no kernel has filled the input
        GS_CUDA(cudaMemsetAsync(control, 0, kControlWords * sizeof(unsigned), stream));
        GS_CUDA(cudaMemsetAsync(input_.zeros.data(), 0, input_.zeros.size_bytes(), stream));
    } else {
        count_visible<<<std::min(num_blocks(n_, kCountBlock * kCountItems), kManyBlocks / 2), kCountBlock, 0, stream>>>(
            std::uint32_t(n_), input_.depth_keys, input_.counts, kDepthPlan, counts.depth_digits, control);
        GS_CUDA_LAUNCHED("count_visible");
        // Large Gaussians are listed only after this sort. The last pass writes the order.
        std::uint32_t *keys = reinterpret_cast<std::uint32_t*>(large_), *values = keys + n_;
        const RadixPairs<std::uint32_t> pairs{{input_.depth_keys, keys}, {values, order_}};
        static_assert(kDepthPlan.passes % 2 == 1);
        sort_pairs(kDepthPlan, pairs, true, counts.depth_digits, counts.depth_sums,
                   {NumPairs::kAll, std::uint32_t(n_), control}, {NumPairs::kVisible, std::uint32_t(n_), control},
                   {.least = kLeastVisible, .chunk_sums = counts.chunk_sums}, stream);
    }
    if (tile_plan().passes == 2)
        sort_instances<std::uint16_t>(splats, room, to_clear, control, counts, stream);
    else
        sort_instances<std::uint32_t>(splats, room, to_clear, control, counts, stream);
    bins_.instances = sorted_;
    bins_.gaussians = keep_slots_ ? gaussians_ : nullptr;
    bins_.tile_offsets = tile_offsets_;
    bins_.longest_first = longest_first_;
    return bins_;
}

}  // namespace gs
