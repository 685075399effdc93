// SPDX-License-Identifier: Apache-2.0
// A stable radix sort of keys and values in as many kernels as it has digits (Adinets and Merrill 2022, "Onesweep").
// Unlike CUB's, it takes the number of pairs from the device, leaves culled pairs out, and has the digits counted and
// all sums zeroed by its caller, who does so once for both sorts: a short list waits longer for such kernels than for
// the passes (docs/results.md#the-sort-in-passes-of-its-own).
#pragma once

#include <cassert>

#include "kernels/sort/binning_cuda.h"
#include "kernels/sort/look_back_cuda.cuh"

namespace gs {

/// The number of pairs, which the host may not know.
struct NumPairs {
    enum Kind { kAll, kVisible, kInstances } kind;
    std::uint32_t most;
    const StepControl* control;

    /// There are no instances if they are too many for their room.
    __device__ std::uint32_t operator()() const {
        if (kind == kAll) return most;
        if (kind == kVisible) return control->num_visible;
        return control->num_instances <= most ? std::uint32_t(control->num_instances) : 0;
    }
};

/// A pass by one digit.
template <class Key> struct Sweep {
    NumPairs num_pairs;
    const Key* keys;
    const std::uint32_t* values;  ///< null: the position of each key
    Key* sorted_keys;             ///< null: not needed
    std::uint32_t* sorted_values;
    const std::uint32_t* counts;  ///< (digits): the pairs with each digit
    std::uint32_t* sums;          ///< (blocks, digits), 0 before: for look_back()
    std::uint32_t least;          ///< pairs with smaller keys are left out
    int shift;
    ChunkSums chunk_sums;
};

/// Adds the tiles of each lane's Gaussian to the sum of the chunk in which its place lies. Places do not fall from lane
/// to lane; lanes without a Gaussian have the largest one and no tiles.
__device__ inline void add_to_chunks(const ChunkSums& sums, std::uint32_t place, std::uint32_t tiles) {
    const std::uint32_t lane = threadIdx.x & 31, chunk = place / ChunkSums::kPairs;
    const std::uint32_t next = __shfl_down_sync(~0u, chunk, 1), up_to = inclusive_sum(tiles);
    const bool is_last = lane == 31 || next != chunk;
    const unsigned before = __ballot_sync(~0u, is_last) & ((1u << lane) - 1);  // the ends of chunks before
    const std::uint32_t up_to_before = __shfl_sync(~0u, up_to, before ? 31 - __clz(before) : 0);
    const std::uint32_t sum = up_to - (before ? up_to_before : 0);
    if (!is_last || sum == 0) return;
    atomicAdd(&sums.of_chunks[chunk], sum);
    atomicAdd(&sums.of_groups[chunk / ChunkSums::kChunksOfGroup], sum);
}

/// Sorts pairs by a digit. Each warp ranks its pairs 32 at a time; the block puts its pairs in order in shared memory,
/// so that those of a digit are written side by side.
template <class Key, int kBits, bool kCulls = false, bool kSums = false>
__global__ void __launch_bounds__(kSweepBlock) sweep_digit(Sweep<Key> a) {
    constexpr int kDigits = 1 << kBits, kWarps = kSweepBlock / 32;
    static_assert(kDigits <= kSweepBlock);
    __shared__ union {
        std::uint32_t counts[kWarps][kDigits];
        struct {
            std::uint32_t values[kSweepPairs];
            Key keys[kSweepPairs];
        } sorted;
    } shared;
    __shared__ std::uint32_t to_all[kDigits], warp_sums[2][kWarps];
    __shared__ uint4 found[kSweepBlock];
    const std::uint32_t n = a.num_pairs(), lane = threadIdx.x & 31, warp = threadIdx.x / 32, digit = threadIdx.x;
    if (std::uint64_t(blockIdx.x) * kSweepPairs >= n) return;
    const auto digit_of = [&](std::uint32_t key) { return key >> a.shift & (kDigits - 1); };

    // A thread has every 32nd of its warp's pairs. `left` are the pairs from its first one on.
    const std::uint32_t first = blockIdx.x * kSweepPairs + warp * (32 * kSweepItems) + lane;
    const int left = int(n - first);
    const Key* const keys = a.keys + first;
    std::uint32_t key[kSweepItems], place[kSweepItems], peers[kSweepItems];
#pragma unroll
    for (int i = 0; i < kSweepItems; ++i) key[i] = 32 * i < left ? keys[32 * i] : 0;
    const std::uint32_t in_all = digit < kDigits ? a.counts[digit] : 0;
    const auto is_kept = [&](int i) { return 32 * i < left && (!kCulls || key[i] >= a.least); };

    // The lanes that have a pair of the same digit, and how many such pairs the warp has before.
    for (int d = int(lane); d < kDigits; d += 32) shared.counts[warp][d] = 0;
    __syncwarp();
#pragma unroll
    for (int i = 0; i < kSweepItems; ++i) {
        const std::uint32_t d = digit_of(key[i]);
        peers[i] = __ballot_sync(~0u, is_kept(i));
#pragma unroll
        for (int b = 0; b < kBits; ++b) {
            const unsigned ones = __ballot_sync(~0u, d >> b & 1);
            peers[i] &= d >> b & 1 ? ones : ~ones;
        }
        place[i] = 0;
        const bool is_last = peers[i] >> lane == 1;
        if (is_kept(i) && is_last) place[i] = atomicAdd(&shared.counts[warp][d], __popc(peers[i]));
        __syncwarp();  // the next pairs are counted after these
    }
#pragma unroll
    for (int i = 0; i < kSweepItems; ++i)
        place[i] =
            __shfl_sync(~0u, place[i], peers[i] ? 31 - __clz(peers[i]) : 0) + __popc(peers[i] & ((1u << lane) - 1));
    __syncthreads();

    // One thread a digit: where it begins in each warp, in the block and in the list.
    std::uint32_t in_block = 0;
    if (digit < kDigits) {
#pragma unroll
        for (int w = 0; w < kWarps; ++w) {
            const std::uint32_t in_warp = shared.counts[w][digit];
            shared.counts[w][digit] = in_block;
            in_block += in_warp;
        }
        publish_sum(&a.sums[std::size_t(blockIdx.x) * kDigits + digit], in_block, blockIdx.x == 0);
    }
    const std::uint32_t up_to_block = inclusive_sum(in_block), up_to_all = inclusive_sum(in_all);
    if (lane == 31) warp_sums[0][warp] = up_to_block, warp_sums[1][warp] = up_to_all;
    std::uint32_t block_begin = up_to_block - in_block, all_begin = up_to_all - in_all, size = 0;
    __syncthreads();
#pragma unroll
    for (std::uint32_t w = 0; w < kWarps; ++w) {
        if (w < warp) block_begin += warp_sums[0][w], all_begin += warp_sums[1][w];
        size += warp_sums[0][w];
    }
    std::uint32_t value[kSweepItems];  // on their way while the block looks back
    if (a.values) {
        const std::uint32_t* const values = a.values + first;
#pragma unroll
        for (int i = 0; i < kSweepItems; ++i) value[i] = 32 * i < left ? values[32 * i] : 0;
    } else {
#pragma unroll
        for (int i = 0; i < kSweepItems; ++i) value[i] = first + 32 * i;
    }
    const std::uint32_t before = look_back<kDigits>(a.sums, found);
    if (digit < kDigits) {
        if (blockIdx.x > 0) publish_sum(&a.sums[std::size_t(blockIdx.x) * kDigits + digit], before + in_block, true);
        to_all[digit] = all_begin + before - block_begin;
#pragma unroll
        for (int w = 0; w < kWarps; ++w) shared.counts[w][digit] += block_begin;
    }
    __syncthreads();

#pragma unroll
    for (int i = 0; i < kSweepItems; ++i) place[i] += shared.counts[warp][digit_of(key[i])];
    __syncthreads();
#pragma unroll
    for (int i = 0; i < kSweepItems; ++i)
        if (is_kept(i)) shared.sorted.keys[place[i]] = Key(key[i]), shared.sorted.values[place[i]] = value[i];
    __syncthreads();
#pragma unroll
    for (int i = 0; i < kSweepItems; ++i) {
        const std::uint32_t p = threadIdx.x + i * kSweepBlock;
        std::uint32_t to = 0xffffffff, tiles = 0;
        if (p < size) {
            const Key k = shared.sorted.keys[p];
            const std::uint32_t v = shared.sorted.values[p];
            to = to_all[digit_of(k)] + p;
            if (a.sorted_keys) a.sorted_keys[to] = k;
            a.sorted_values[to] = v;
            if constexpr (kSums) {
                tiles = k >> kDepthKeyBits;
                if (tiles == kManyTiles) tiles = a.chunk_sums.tiles[v];
            }
        }
        if constexpr (kSums) add_to_chunks(a.chunk_sums, to, tiles);
    }
}

/// The buffers of a sort. Pass i goes from those at i % 2 to the other ones.
template <class Key> struct RadixPairs {
    Key* keys[2];
    std::uint32_t* values[2];
};

/// Sorts pairs by the lower bits of their keys, as the plan has them. keys[0] is overwritten. The first pass does not
/// read values[0] where the values are positions; the last pass does not write keys where nobody needs them. counts:
/// (passes, digits), of the keys that are kept. sums: plan.sums(num.most) words for each pass, which are 0. Of 32-bit
/// keys, which must have digits of 8 bits and two passes or more, pairs with keys below `least` are left out by the
/// first pass, and num_kept says how many there are after that; the last pass adds up chunk_sums. Shorter keys are all
/// kept.
template <class Key>
void sort_pairs(const DigitPlan& plan, const RadixPairs<Key>& pairs, bool from_positions, bool keys_needed,
                const std::uint32_t* counts, std::uint32_t* sums, const NumPairs& num, const NumPairs& num_kept,
                std::uint32_t least, const ChunkSums& chunk_sums, cudaStream_t stream) {
    if (num.most == 0) return;
    assert(sizeof(Key) == 2 ? least == 0 && !chunk_sums.of_chunks : plan.bits == 8 && plan.passes > 1);
    for (int p = 0; p < plan.passes; ++p) {
        const int from = p % 2, to = 1 - from;
        const bool is_last = p + 1 == plan.passes;
        const Sweep<Key> pass{p ? num_kept : num,
                              pairs.keys[from],
                              p || !from_positions ? pairs.values[from] : nullptr,
                              !is_last || keys_needed ? pairs.keys[to] : nullptr,
                              pairs.values[to],
                              counts + p * plan.digits(),
                              sums + std::size_t(p) * plan.sums(num.most),
                              least,
                              p * plan.bits,
                              chunk_sums};
        const auto kernel = [&] {
            if constexpr (sizeof(Key) == 2) {
                return plan.bits == 7 ? &sweep_digit<Key, 7> : &sweep_digit<Key, 8>;
            } else {
                if (p == 0 && least > 0) return &sweep_digit<Key, 8, true>;
                return is_last && chunk_sums.of_chunks ? &sweep_digit<Key, 8, false, true> : &sweep_digit<Key, 8>;
            }
        }();
        kernel<<<num_blocks(num.most, kSweepPairs), kSweepBlock, 0, stream>>>(pass);
        GS_CUDA_LAUNCHED("sweep_digit");
    }
}

}  // namespace gs
