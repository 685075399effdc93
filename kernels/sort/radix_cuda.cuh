// SPDX-License-Identifier: Apache-2.0
// A stable radix sort of keys and values in as many kernels as the keys have digits (Adinets and Merrill 2022,
// "Onesweep"). Unlike CUB's, it reads the number of pairs on the device and drops culled pairs. Its caller counts the
// digits and zeroes all sums, once for both sorts: for a short list, kernels for this take longer than the passes
// (docs/lab/sorting.md#the-sort-in-passes-of-its-own).
#pragma once

#include <cassert>

#include "kernels/cuda/cuda.h"
#include "kernels/sort/binning_cuda.h"

namespace gs {

// Sums over all earlier blocks, which the blocks of a kernel exchange (Merrill and Garland 2016, "decoupled
// look-back"). Blocks also add up their sums in groups, so that a block reads one word for each earlier group: with a
// few hundred blocks each reads once or twice, not once for every 16 earlier blocks.

/// Returns the sum over the lanes up to this one.
__device__ inline std::uint32_t inclusive_sum(std::uint32_t x) {
#pragma unroll
    for (int d = 1; d < 32; d *= 2) {
        const std::uint32_t other = __shfl_up_sync(~0u, x, d);
        if (int(threadIdx.x & 31) >= d) x += other;
    }
    return x;
}

/// The sums of blocks in kColumns columns.
///
/// A block waits for earlier blocks. Blocks start in index order, so earlier blocks are running or have ended; and
/// every block publishes its own sum before it waits.
template <int kColumns> class BlockSums {
  public:
    /// Largest sum of a block. The word of a group has 20 bits for the sum of its blocks.
    static constexpr std::uint32_t kMostSum = ((1u << 20) - 1) / kBlocksOfGroup;

    /// Uses block_sums(gridDim.x, kColumns) `words`, initially 0.
    __device__ explicit BlockSums(std::uint32_t* words)
        : blocks_(words), groups_(words + std::size_t(gridDim.x) * kColumns) {}

    /// Publishes this block's sum in a column to later blocks.
    __device__ void tell(int column, std::uint32_t sum) const {
        // Relaxed: it publishes no other data.
        asm volatile("st.relaxed.gpu.u32 [%0], %1;" ::"l"(block(blockIdx.x) + column), "r"(kTold | sum) : "memory");
        if (own_group() < num_groups()) atomicAdd(group(own_group()) + column, kOneBlock + sum);
    }

    /// Returns, for column threadIdx.x, the sum over all earlier blocks; `own_sum` is this block's sum in that column.
    /// All threads of the block call it. Sets of threads read four columns of some words each, many words at once.
    template <int kThreads> __device__ std::uint32_t before(std::uint32_t own_sum, uint4 (&found)[kThreads]) const {
        constexpr int kFours = kColumns / 4, kReaders = kThreads / kFours, kAhead = 4;
        const int reader = int(threadIdx.x) / kFours, four = int(threadIdx.x) % kFours;
        // First the words of earlier blocks in the same group, then the words of earlier groups, backwards. The last
        // block of a group instead waits for the whole group, whose word it will replace.
        const bool ends_group = blockIdx.x % kBlocksOfGroup == kBlocksOfGroup - 1;
        const int of_blocks = ends_group ? 0 : int(blockIdx.x % kBlocksOfGroup),
                  last_group = ends_group ? own_group() : own_group() - 1, num_words = of_blocks + last_group + 1;
        const auto read = [&](int k) {
            uint4 w;
            asm volatile(
                "ld.relaxed.gpu.v4.u32 {%0,%1,%2,%3}, [%4];"
                : "=r"(w.x), "=r"(w.y), "=r"(w.z), "=r"(w.w)
                : "l"((k < of_blocks ? block(int(blockIdx.x) - 1 - k) : group(last_group - (k - of_blocks))) + 4 * four)
                : "memory");
            return w;
        };
        std::uint32_t sum = 0;
        bool open = threadIdx.x < kColumns;
        for (int first = 0; first < num_words; first += kReaders * kAhead) {
            const int from = first + reader * kAhead;
            uint4 w[kAhead];
#pragma unroll
            for (int u = 0; u < kAhead; ++u)
                w[u] = from + u < num_words ? read(from + u) : make_uint4(kAll, kAll, kAll, kAll);
            std::uint32_t s[4] = {};
            bool done[4] = {};
#pragma unroll
            for (int u = 0; u < kAhead; ++u) {
                const bool is_block = from + u < of_blocks;
                const std::uint32_t known = is_block ? kTold : ~(kWholeGroup - 1);
                while (!(w[u].x & known && w[u].y & known && w[u].z & known && w[u].w & known)) w[u] = read(from + u);
                const std::uint32_t of[4] = {w[u].x, w[u].y, w[u].z, w[u].w};
#pragma unroll
                for (int c = 0; c < 4; ++c) {
                    if (done[c]) continue;
                    done[c] = !is_block && of[c] & kAll;
                    s[c] += of[c] & (done[c] ? ~kAll : kOneBlock - 1);
                }
            }
            const auto note = [&](int c) { return s[c] | (done[c] ? kAll : 0); };
            found[threadIdx.x] = make_uint4(note(0), note(1), note(2), note(3));
            __syncthreads();
            for (int r = 0; r < kReaders && open; ++r) {
                const std::uint32_t x = reinterpret_cast<const std::uint32_t*>(found)[r * kColumns + threadIdx.x];
                sum += x & ~kAll;
                open = !(x & kAll);
            }
            if (!__syncthreads_or(open)) break;
        }
        if (ends_group && threadIdx.x < kColumns) {
            asm volatile("st.relaxed.gpu.u32 [%0], %1;" ::"l"(group(own_group()) + threadIdx.x), "r"(kAll | sum)
                         : "memory");
            sum -= own_sum;
        }
        return sum;
    }

  private:
    // A block's word is its sum with kTold. The word of a group holds the sum of its blocks in the lower bits and their
    // number from kOneBlock up. Once the group is complete, its last block replaces the word by the sum over all blocks
    // so far, with kAll.
    static constexpr std::uint32_t kTold = 1u << 31, kAll = 1u << 31, kOneBlock = 1u << 20,
                                   kWholeGroup = kBlocksOfGroup * kOneBlock;

    __device__ std::uint32_t* block(int b) const { return blocks_ + std::size_t(b) * kColumns; }
    __device__ std::uint32_t* group(int g) const { return groups_ + std::size_t(g) * kColumns; }
    __device__ static int own_group() { return int(blockIdx.x) / kBlocksOfGroup; }
    __device__ static int num_groups() { return int(gridDim.x) / kBlocksOfGroup; }  ///< complete groups

    std::uint32_t *blocks_, *groups_;
};

/// The number of pairs, which may be known only on the device.
struct NumPairs {
    enum Kind { kAll, kVisible, kInstances } kind;
    std::uint32_t most;
    const StepControl* control;

    /// Returns the number of pairs: 0 instances if they exceed their room.
    __device__ std::uint32_t operator()() const {
        if (kind == kAll) return most;
        if (kind == kVisible) return control->num_visible;
        return control->num_instances <= most ? std::uint32_t(control->num_instances) : 0;
    }
};

/// Start of the pairs of each key in the sorted list, which the last pass records as it writes.
struct KeyBegins {
    std::uint32_t* words = nullptr;  ///< (most + 1), initially 0: ~ of the first pair's position, 0 if there is none
    std::uint32_t most = 0;          ///< larger keys count as this one
};

/// Additional work of passes besides sorting.
enum class SweepTask { kSort, kCull, kAddUpTiles, kNoteBegins };

/// One pass over a digit.
template <class Key> struct Sweep {
    NumPairs num_pairs;
    const Key* keys;
    const std::uint32_t* values;  ///< null: use the position of each key
    Key* sorted_keys;             ///< null: not needed
    std::uint32_t* sorted_values;
    const std::uint32_t* counts;  ///< (digits) number of pairs with each digit
    std::uint32_t* sums;          ///< for BlockSums, initially 0
    int shift;
    std::uint32_t least;  ///< kCull: pairs with smaller keys are left out
    ChunkSums chunk_sums;
    KeyBegins begins;
};

/// Adds up the tiles touched by a block's Gaussians, by chunk. The Gaussians of a digit are adjacent in the sorted
/// list, mostly in one or two chunks: these have sums in shared memory.
template <int kDigits> struct TilesOfDigits {
    static constexpr std::uint32_t kChunks = 2;
    std::uint32_t first_chunk[kDigits], sums[kDigits][kChunks];

    /// Begins a digit, whose Gaussians start at `first`. One thread calls it.
    __device__ void begin(std::uint32_t digit, std::uint32_t first) {
        first_chunk[digit] = first / ChunkSums::kPairs;
        for (std::uint32_t& sum : sums[digit]) sum = 0;
    }
    __device__ void add(std::uint32_t digit, std::uint32_t place, std::uint32_t tiles, const ChunkSums& all) {
        const std::uint32_t chunk = place / ChunkSums::kPairs, k = chunk - first_chunk[digit];
        k < kChunks ? void(atomicAdd(&sums[digit][k], tiles)) : add_to_chunk(chunk, tiles, all);
    }
    /// Adds the sums of a digit to the global sums.
    __device__ void end(std::uint32_t digit, const ChunkSums& all) const {
        for (std::uint32_t k = 0; k < kChunks; ++k)
            if (sums[digit][k] > 0) add_to_chunk(first_chunk[digit] + k, sums[digit][k], all);
    }

  private:
    __device__ static void add_to_chunk(std::uint32_t chunk, std::uint32_t tiles, const ChunkSums& all) {
        atomicAdd(&all.of_chunks[chunk], tiles);
        atomicAdd(&all.of_groups[chunk / ChunkSums::kChunksOfGroup], tiles);
    }
};

/// Sorts pairs by a digit. Each warp ranks its pairs 32 at a time; the block orders its pairs in shared memory, so that
/// pairs of the same digit are written contiguously.
template <class Key, int kBits, SweepTask kTask>
__global__ void __launch_bounds__(kSweepBlock) sweep_digit(Sweep<Key> a) {
    constexpr int kDigits = 1 << kBits, kWarps = kSweepBlock / 32;
    static_assert(kDigits <= kSweepBlock);
    __shared__ union {
        uint2 ranked[kWarps][kDigits];  // lanes with a pair of this digit now, and the warp's earlier pairs
        struct {
            std::uint32_t values[kSweepPairs];
            Key keys[kSweepPairs];
        } sorted;
    } shared;
    __shared__ std::uint32_t to_all[kDigits], warp_sums[2][kWarps];
    __shared__ TilesOfDigits<kTask == SweepTask::kAddUpTiles ? kDigits : 1> tiles_of;
    __shared__ uint4 found[kSweepBlock];
    const std::uint32_t n = a.num_pairs(), lane = threadIdx.x & 31, warp = threadIdx.x / 32, digit = threadIdx.x;
    if (std::uint64_t(blockIdx.x) * kSweepPairs >= n) return;
    const auto digit_of = [&](std::uint32_t key) { return key >> a.shift & (kDigits - 1); };

    // A thread has every 32nd of its warp's pairs. `left` is the number of pairs from its first one on.
    const std::uint32_t first = blockIdx.x * kSweepPairs + warp * (32 * kSweepItems) + lane;
    const int left = int(n - first);
    const Key* const keys = a.keys + first;
    std::uint32_t key[kSweepItems], place[kSweepItems];
#pragma unroll
    for (int i = 0; i < kSweepItems; ++i) key[i] = 32 * i < left ? keys[32 * i] : 0;
    const std::uint32_t in_all = digit < kDigits ? a.counts[digit] : 0;
    const auto is_kept = [&](int i) { return 32 * i < left && (kTask != SweepTask::kCull || key[i] >= a.least); };

    // Each lane marks its digit. The marks of lower lanes plus the number of earlier pairs give its rank; the highest
    // lane clears the marks and adds their number. Votes on each bit of a digit would also find its lanes, but a
    // multiprocessor can only vote every fourth cycle.
    for (int d = int(lane); d < kDigits; d += 32) shared.ranked[warp][d] = make_uint2(0, 0);
    __syncwarp();
#pragma unroll
    for (int i = 0; i < kSweepItems; ++i) {
        uint2& ranked = shared.ranked[warp][digit_of(key[i])];
        if (is_kept(i)) atomicOr(&ranked.x, 1u << lane);
        __syncwarp();
        const uint2 now = ranked;
        place[i] = now.y + __popc(now.x & ((1u << lane) - 1));
        __syncwarp();
        const bool is_last = now.x >> lane == 1;
        if (is_kept(i) && is_last) ranked = make_uint2(0, now.y + __popc(now.x));
        __syncwarp();
    }
    __syncthreads();

    // One thread per digit finds its start in each warp, in the block and in the list.
    const BlockSums<kDigits> sums(a.sums);
    static_assert(kSweepPairs <= BlockSums<kDigits>::kMostSum);
    std::uint32_t in_block = 0;
    if (digit < kDigits) {
#pragma unroll
        for (int w = 0; w < kWarps; ++w) {
            std::uint32_t& begin = shared.ranked[w][digit].y;
            const std::uint32_t in_warp = begin;
            begin = in_block;
            in_block += in_warp;
        }
        sums.tell(int(digit), in_block);
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
    std::uint32_t value[kSweepItems];  // loads while the block looks back
    if (a.values) {
        const std::uint32_t* const values = a.values + first;
#pragma unroll
        for (int i = 0; i < kSweepItems; ++i) value[i] = 32 * i < left ? values[32 * i] : 0;
    } else {
#pragma unroll
        for (int i = 0; i < kSweepItems; ++i) value[i] = first + 32 * i;
    }
    const std::uint32_t before = sums.before(in_block, found);
    if (digit < kDigits) {
        to_all[digit] = all_begin + before - block_begin;
        if constexpr (kTask == SweepTask::kAddUpTiles) tiles_of.begin(digit, all_begin + before);
#pragma unroll
        for (int w = 0; w < kWarps; ++w) shared.ranked[w][digit].y += block_begin;
    }
    __syncthreads();

#pragma unroll
    for (int i = 0; i < kSweepItems; ++i) place[i] += shared.ranked[warp][digit_of(key[i])].y;
    __syncthreads();
#pragma unroll
    for (int i = 0; i < kSweepItems; ++i) {
        if (!is_kept(i)) continue;
        shared.sorted.keys[place[i]] = Key(key[i]), shared.sorted.values[place[i]] = value[i];
        if constexpr (kTask == SweepTask::kAddUpTiles) {
            const std::uint32_t some = key[i] >> kDepthKeyBits;
            tiles_of.add(digit_of(key[i]), to_all[digit_of(key[i])] + place[i],
                         some < kManyTiles ? some : a.chunk_sums.tiles[value[i]], a.chunk_sums);
        }
    }
    __syncthreads();
#pragma unroll
    for (int i = 0; i < kSweepItems; ++i) {
        const std::uint32_t p = threadIdx.x + i * kSweepBlock;
        if (p >= size) continue;
        const Key k = shared.sorted.keys[p];
        const std::uint32_t v = shared.sorted.values[p], to = to_all[digit_of(k)] + p;
        if (a.sorted_keys) a.sorted_keys[to] = k;
        a.sorted_values[to] = v;
        if constexpr (kTask == SweepTask::kNoteBegins) {
            // Equal keys are adjacent, since earlier passes sorted by all other digits.
            if (p == 0 || shared.sorted.keys[p - 1] != k)
                atomicMax(&a.begins.words[min(std::uint32_t(k), a.begins.most)], ~to);
        }
    }
    if constexpr (kTask == SweepTask::kAddUpTiles)
        if (digit < kDigits) tiles_of.end(digit, a.chunk_sums);
}

/// The buffers of a sort. Pass i reads the buffers i % 2 and writes the others.
template <class Key> struct RadixPairs {
    Key* keys[2];
    std::uint32_t* values[2];
};

/// Additional work of a sort. 32-bit keys must have digits of 8 bits and at least two passes; 16-bit keys support only
/// `begins`.
struct SortTasks {
    std::uint32_t least = 0;    ///< the first pass drops pairs with smaller keys
    ChunkSums chunk_sums = {};  ///< the last pass adds these up, if given
    KeyBegins begins = {};      ///< or records these
};

/// Sorts pairs by the lower bits of their keys, according to `plan`. keys[0] is overwritten. The first pass does not
/// read values[0] if the values are positions; the last pass writes no keys. counts: (passes, digits), of the keys that
/// are kept. sums: plan.sums(num.most) words for each pass, which are 0. num_kept is the number of pairs that the first
/// pass keeps.
template <class Key>
void sort_pairs(const DigitPlan& plan, const RadixPairs<Key>& pairs, bool from_positions, const std::uint32_t* counts,
                std::uint32_t* sums, const NumPairs& num, const NumPairs& num_kept, const SortTasks& tasks,
                cudaStream_t stream) {
    if (num.most == 0) return;
    const bool culls = tasks.least > 0, adds_up = tasks.chunk_sums.of_chunks, notes = tasks.begins.words;
    assert(sizeof(Key) == 2 ? !culls && !adds_up : plan.bits == 8 && plan.passes > 1);
    for (int p = 0; p < plan.passes; ++p) {
        const int from = p % 2, to = 1 - from;
        const bool is_last = p + 1 == plan.passes;
        const Sweep<Key> pass{p ? num_kept : num,
                              pairs.keys[from],
                              p || !from_positions ? pairs.values[from] : nullptr,
                              is_last ? nullptr : pairs.keys[to],
                              pairs.values[to],
                              counts + p * plan.digits(),
                              sums + std::size_t(p) * plan.sums(num.most),
                              p * plan.bits,
                              tasks.least,
                              tasks.chunk_sums,
                              tasks.begins};
        const auto kernel = [&] {
            using enum SweepTask;
            if constexpr (sizeof(Key) == 2) {
                if (is_last && notes)
                    return plan.bits == 7 ? &sweep_digit<Key, 7, kNoteBegins> : &sweep_digit<Key, 8, kNoteBegins>;
                return plan.bits == 7 ? &sweep_digit<Key, 7, kSort> : &sweep_digit<Key, 8, kSort>;
            } else {
                if (p == 0 && culls) return &sweep_digit<Key, 8, kCull>;
                if (is_last && adds_up) return &sweep_digit<Key, 8, kAddUpTiles>;
                return is_last && notes ? &sweep_digit<Key, 8, kNoteBegins> : &sweep_digit<Key, 8, kSort>;
            }
        }();
        kernel<<<num_blocks(num.most, kSweepPairs), kSweepBlock, 0, stream>>>(pass);
        GS_CUDA_LAUNCHED("sweep_digit");
    }
}

}  // namespace gs
