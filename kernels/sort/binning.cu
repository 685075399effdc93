// SPDX-License-Identifier: Apache-2.0
// Radix sorts of Gaussians by depth and of their instances by tile.
#include <cub/agent/single_pass_scan_operators.cuh>
#include <cub/block/block_scan.cuh>
#include <cub/device/device_radix_sort.cuh>
#include <cuda/std/functional>

#include "kernels/sort/binning_cuda.h"

namespace gs {
namespace {

constexpr int kBlock = 256, kWriteBlock = 512;
constexpr unsigned kManyBlocks = 512;  ///< enough to fill a large device once

/// The sums of instances so far, which blocks hand on to those behind them.
using ScanState = cub::ScanTileState<std::uint32_t>;

__global__ void fill_identity(std::uint32_t n, std::uint32_t* indices) {
    const std::uint32_t i = blockIdx.x * kBlock + threadIdx.x;
    if (i < n) indices[i] = i;
}

/// Returns the sum of `x` over the lanes up to this one.
__device__ std::uint32_t inclusive_sum(std::uint32_t x) {
    for (int d = 1; d < 32; d *= 2) {
        const std::uint32_t other = __shfl_up_sync(~0u, x, d);
        if (int(threadIdx.x & 31) >= d) x += other;
    }
    return x;
}

/// What writing instances reads and writes.
template <class Key> struct InstanceLists {
    std::uint32_t n, room;
    const std::uint32_t* order;   ///< visible Gaussians, front to back
    const std::uint32_t* counts;  ///< (n)
    const TileSpan* spans;        ///< (n)
    Key* tile_keys;               ///< (room)
    std::uint32_t* instances;     ///< (room): the Gaussian of each
    std::uint32_t* ends;          ///< (n) or null: in depth order, the end of each one's instances
    uint2* large;                 ///< (n): Gaussians with more than 32 candidate tiles, and the first instance of each
};

__global__ void __launch_bounds__(kBlock) begin_scan(ScanState state, int blocks) { state.InitializeStatus(blocks); }

/// Writes the instances of a block's Gaussians in depth order. Those with more than 32 candidate tiles, which come
/// together in depth order, are left for write_large_instances.
template <class Key>
__global__ void __launch_bounds__(kWriteBlock)
    write_instances(InstanceLists<Key> lists, ScanState state, int tiles_x, StepControl* control) {
    using BlockScan = cub::BlockScan<std::uint32_t, kWriteBlock>;
    using Prefix = cub::TilePrefixCallbackOp<std::uint32_t, cuda::std::plus<>, ScanState>;
    __shared__ typename BlockScan::TempStorage scan;
    __shared__ typename Prefix::TempStorage prefix;
    __shared__ std::uint16_t candidates[kWriteBlock / 32][32 * 32];  // lane and candidate tile of a warp's instances
    const std::uint32_t k = blockIdx.x * kWriteBlock + threadIdx.x, num_visible = control->num_visible;
    const bool fits = control->num_instances <= lists.room;
    // All of the room is sorted: behind the last instance come keys beyond every tile.
    for (std::uint32_t i = (fits ? std::uint32_t(control->num_instances) : 0) + k; i < lists.room;
         i += gridDim.x * kWriteBlock)
        lists.tile_keys[i] = Key(~Key(0)), lists.instances[i] = 0;
    if (!fits) {
        if (k == 0) control->stopped = 1;
        return;
    }
    if (blockIdx.x * kWriteBlock >= num_visible) {  // nobody waits for this block's sum
        if (lists.ends && k < lists.n) lists.ends[k] = std::uint32_t(control->num_instances);
        return;
    }
    const bool visible = k < num_visible;
    const std::uint32_t gaussian = visible ? lists.order[k] : 0, count = visible ? lists.counts[gaussian] : 0;
    const TileSpan span = visible ? lists.spans[gaussian] : TileSpan{0, 0};
    std::uint32_t start;
    if (blockIdx.x == 0) {
        std::uint32_t sum;
        BlockScan(scan).ExclusiveSum(count, start, sum);
        if (threadIdx.x == 0) state.SetInclusive(0, sum);
    } else {
        Prefix before(state, prefix, cuda::std::plus<>{});
        BlockScan(scan).ExclusiveSum(count, start, before);
    }
    if (lists.ends && k < lists.n) lists.ends[k] = start + count;
    const bool small = visible && span.width() > 0;
    if (visible && !small) lists.large[atomicAdd(&control->num_large, 1u)] = make_uint2(gaussian, start);

    // Lanes have different numbers of instances: the warp lists them, and then each lane writes every 32nd.
    std::uint16_t* list = candidates[threadIdx.x / 32];
    const std::uint32_t lane = threadIdx.x & 31, own = small ? count : 0, end = inclusive_sum(own);
    std::uint32_t at = end - own;
    const std::uint32_t place_to_instance = start - at, total = __shfl_sync(~0u, end, 31);
    if (small)
        for (unsigned bits = span.mask; bits; bits &= bits - 1)
            list[at++] = std::uint16_t(lane << 5 | (__ffs(bits) - 1));
    __syncwarp();
    for (std::uint32_t place = lane; place - lane < total; place += 32) {
        const std::uint32_t word = place < total ? list[place] : 0, owner = word >> 5;
        const TileSpan tiles{__shfl_sync(~0u, span.where, owner), 0};
        const std::uint32_t g = __shfl_sync(~0u, gaussian, owner),
                            i = place + __shfl_sync(~0u, place_to_instance, owner);
        if (place >= total) continue;
        // The half keeps the quotient away from whole numbers, which the rounding could cross.
        const int candidate = word & 31, row = int((candidate + 0.5f) / tiles.width());
        lists.tile_keys[i] = Key((tiles.y0() + row) * tiles_x + tiles.x0() + candidate - row * tiles.width());
        lists.instances[i] = g;
    }
}

/// Writes the instances of large Gaussians, with a warp for each.
template <class Key>
__global__ void __launch_bounds__(kBlock)
    write_large_instances(InstanceLists<Key> lists, const PackedSplat* __restrict__ splats, int tiles_x,
                          const StepControl* __restrict__ control) {
    if (control->num_instances > lists.room) return;
    const std::uint32_t lane = threadIdx.x & 31;
    for (std::uint32_t item = (blockIdx.x * kBlock + threadIdx.x) / 32; item < control->num_large;
         item += gridDim.x * kBlock / 32) {
        const std::uint32_t gaussian = lists.large[item].x, stop = lists.large[item].y + lists.counts[gaussian];
        std::uint32_t at = lists.large[item].y;
        const PackedSplat s = splats[gaussian];
        const TileRectangle r(s.bounds());
        for (int y = r.y0; y < r.y0 + r.height; y += 32) {
            const TileRows::Span mine = span_of_lane(s, y, r.y0 + r.height);
            for (int row = 0; row < min(32, r.y0 + r.height - y); ++row) {
                const int x0 = __shfl_sync(~0u, mine.x0, row), size = __shfl_sync(~0u, mine.x1, row) - x0;
                for (int x = int(lane); x < size && at + x < stop; x += 32) {
                    lists.tile_keys[at + x] = Key((y + row) * tiles_x + x0 + x);
                    lists.instances[at + x] = gaussian;
                }
                at += size;
            }
        }
    }
}

/// Sets offsets[t] to the first instance of a tile >= t. A thread looks whether lists begin at some instances in a row;
/// one place lies behind the last instance. Keys beyond the last instance exceed every tile.
constexpr int kKeysOfThread = 8;
template <class Key>
__global__ void __launch_bounds__(kBlock)
    find_tile_offsets(std::uint32_t room, const Key* __restrict__ tiles, std::uint32_t num_tiles,
                      std::uint32_t* __restrict__ offsets) {
    const std::uint32_t first = (blockIdx.x * kBlock + threadIdx.x) * kKeysOfThread;
    if (first > room) return;
    const auto tile = [&](std::uint32_t i) { return i < room ? min(std::uint32_t(tiles[i]), num_tiles) : num_tiles; };
    std::uint32_t found[kKeysOfThread], next = first > 0 ? tile(first - 1) + 1 : 0;
#pragma unroll
    for (int u = 0; u < kKeysOfThread; ++u) found[u] = tile(first + u);
#pragma unroll
    for (int u = 0; u < kKeysOfThread; ++u)
        for (; next <= found[u]; ++next) offsets[next] = min(first + u, room);
}

/// Lists the work on tiles by the time that it takes, in steps of 16 instances, with a counting sort in one block.
constexpr int kOrderThreads = 1024, kLengths = 256;
__global__ void __launch_bounds__(kOrderThreads)
    order_tiles(std::uint32_t num_tiles, std::uint32_t num_items, const std::uint32_t* __restrict__ offsets,
                TileItem* __restrict__ longest_first) {
    constexpr std::uint32_t kShortest = 256;  // is not worth three more blocks
    __shared__ std::uint32_t place[kLengths], listed;
    const std::uint32_t limit = max(offsets[num_tiles] / kMostQuartered, kShortest);
    // Calls fn(tile, length) for the tiles of this thread, with several loads on their way at once.
    const auto for_tiles = [&](auto fn) {
        constexpr int kAtOnce = 8;
        for (std::uint32_t first = threadIdx.x; first < num_tiles; first += kAtOnce * kOrderThreads) {
            std::uint32_t begin[kAtOnce], end[kAtOnce];
#pragma unroll
            for (int u = 0; u < kAtOnce; ++u)
                if (const std::uint32_t t = first + u * kOrderThreads; t < num_tiles)
                    begin[u] = offsets[t], end[u] = offsets[t + 1];
#pragma unroll
            for (int u = 0; u < kAtOnce; ++u)
                if (const std::uint32_t t = first + u * kOrderThreads; t < num_tiles) fn(t, end[u] - begin[u]);
        }
    };
    const auto bin = [&](std::uint32_t n) {
        return kLengths - 1 - min((n > limit ? n / 2 : n) / 16, std::uint32_t(kLengths - 1));
    };
    if (threadIdx.x < kLengths) place[threadIdx.x] = 0;
    __syncthreads();
    for_tiles([&](std::uint32_t, std::uint32_t n) { atomicAdd(&place[bin(n)], n > limit ? 4u : 1u); });
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
    for_tiles([&](std::uint32_t t, std::uint32_t n) {
        const std::uint32_t at = atomicAdd(&place[bin(n)], n > limit ? 4u : 1u);
        if (n > limit)
            for (int k = 0; k < 4; ++k) longest_first[at + k] = TileItem::part(t, k);
        else
            longest_first[at] = TileItem::whole(t);
    });
    for (std::uint32_t k = listed + threadIdx.x; k < num_items; k += kOrderThreads) longest_first[k] = {};
}

template <class Key> std::size_t sort_bytes(std::int64_t items, int bits) {
    std::size_t bytes = 0;
    GS_CUDA(cub::DeviceRadixSort::SortPairs(nullptr, bytes, static_cast<const Key*>(nullptr),
                                            static_cast<Key*>(nullptr), static_cast<const std::uint32_t*>(nullptr),
                                            static_cast<std::uint32_t*>(nullptr), int(items), 0, bits));
    return bytes;
}

}  // namespace

int CudaBinning::tile_bits() const {
    int bits = 1;  // the values exceed the tiles by one, for keys beyond the last instance
    while ((std::int64_t(1) << bits) <= bins_.num_tiles()) ++bits;
    return bits;
}

void CudaBinning::take_results(Carver& c, std::int64_t n, std::int64_t capacity, int width, int height,
                               bool keep_slots) {
    n_ = n, capacity_ = capacity, keep_slots_ = keep_slots;
    bins_.tiles_x = (width + kCudaTileX - 1) / kCudaTileX;
    bins_.tiles_y = (height + kCudaTileY - 1) / kCudaTileY;
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

void CudaBinning::take_temporaries(Carver& c) {
    input_.depth_keys = c.take<std::uint32_t>(n_);
    input_.spans = c.take<TileSpan>(n_);
    large_ = c.take<uint2>(n_);
    if (!keep_slots_) order_ = c.take<std::uint32_t>(n_);
    const bool small = tile_bits() <= 16;
    const std::size_t key_words = small ? (capacity_ + 1) / 2 : capacity_;
    tile_keys_ = c.take<std::uint32_t>(key_words);
    sorted_tile_keys_ = c.take<std::uint32_t>(key_words);
    unsorted_ = keep_slots_ ? gaussians_ : c.take<std::uint32_t>(capacity_);
    std::size_t scan = 0;
    GS_CUDA(ScanState::AllocationSize(int(num_blocks(n_, kWriteBlock)), scan));
    workspace_bytes_ = std::max({scan, sort_bytes<std::uint32_t>(n_, kDepthKeyBits),
                                 small ? sort_bytes<std::uint16_t>(capacity_, tile_bits())
                                       : sort_bytes<std::uint32_t>(capacity_, tile_bits())});
    workspace_ = c.take<unsigned char>(workspace_bytes_);
}

template <class Key>
void CudaBinning::sort_instances(const PackedSplat* splats, std::int64_t room, StepControl* control,
                                 cudaStream_t stream) {
    Key *keys = reinterpret_cast<Key*>(tile_keys_), *sorted_keys = reinterpret_cast<Key*>(sorted_tile_keys_);
    const InstanceLists<Key> lists{
        std::uint32_t(n_), std::uint32_t(room), order_, input_.counts, input_.spans, keys, unsorted_, ends_, large_};
    // At least so many blocks that what lies behind the last instance is not left to a few.
    const unsigned scanned = num_blocks(n_, kWriteBlock),
                   blocks = std::max(scanned, std::min(num_blocks(room + 1, kWriteBlock), kManyBlocks));
    ScanState sums;
    GS_CUDA(sums.Init(int(scanned), workspace_, workspace_bytes_));
    if (n_ > 0) {
        begin_scan<<<num_blocks(scanned, kBlock), kBlock, 0, stream>>>(sums, int(scanned));
        GS_CUDA_LAUNCHED("begin_scan");
    }
    write_instances<Key><<<blocks, kWriteBlock, 0, stream>>>(lists, sums, bins_.tiles_x, control);
    GS_CUDA_LAUNCHED("write_instances");
    if (n_ > 0) {
        write_large_instances<Key><<<kManyBlocks, kBlock, 0, stream>>>(lists, splats, bins_.tiles_x, control);
        GS_CUDA_LAUNCHED("write_large_instances");
    }
    std::size_t bytes = workspace_bytes_;
    GS_CUDA(cub::DeviceRadixSort::SortPairs(workspace_, bytes, keys, sorted_keys,
                                            keep_slots_ ? identity_.get() : unsorted_, sorted_, int(room), 0,
                                            tile_bits(), stream));
    find_tile_offsets<Key><<<num_blocks(room + 1, kBlock * kKeysOfThread), kBlock, 0, stream>>>(
        std::uint32_t(room), sorted_keys, bins_.num_tiles(), tile_offsets_);
    GS_CUDA_LAUNCHED("find_tile_offsets");
    order_tiles<<<1, kOrderThreads, 0, stream>>>(bins_.num_tiles(), bins_.num_items(), tile_offsets_, longest_first_);
    GS_CUDA_LAUNCHED("order_tiles");
}

CudaBins CudaBinning::build(const PackedSplat* splats, std::int64_t room, StepControl* control, cudaStream_t stream) {
    const std::size_t identities = std::max(n_, keep_slots_ ? capacity_ : 0);
    if (identities > identity_.capacity()) {
        identity_.reserve(identities);
        fill_identity<<<num_blocks(identity_.capacity(), kBlock), kBlock, 0, stream>>>(
            std::uint32_t(identity_.capacity()), identity_.get());
        GS_CUDA_LAUNCHED("fill_identity");
    }
    if (n_ > 0) {
        // Nobody reads the sorted keys, so their place then holds the list of large Gaussians.
        std::uint32_t* sorted_keys = reinterpret_cast<std::uint32_t*>(large_);
        std::size_t bytes = workspace_bytes_;
        GS_CUDA(cub::DeviceRadixSort::SortPairs(workspace_, bytes, input_.depth_keys, sorted_keys, identity_.get(),
                                                order_, int(n_), 0, kDepthKeyBits, stream));
    }
    if (tile_bits() <= 16)
        sort_instances<std::uint16_t>(splats, room, control, stream);
    else
        sort_instances<std::uint32_t>(splats, room, control, stream);
    bins_.instances = sorted_;
    bins_.gaussians = keep_slots_ ? gaussians_ : nullptr;
    bins_.tile_offsets = tile_offsets_;
    bins_.longest_first = longest_first_;
    return bins_;
}

}  // namespace gs
