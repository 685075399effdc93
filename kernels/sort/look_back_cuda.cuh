// SPDX-License-Identifier: Apache-2.0
// Sums over the blocks before a block, which the blocks of a kernel tell one another (Merrill and Garland 2016,
// "decoupled look-back"). Blocks also add up their sums in groups, so that a block reads one word for a group before
// its own: among a few hundred blocks each reads once or twice, not once for every 16 blocks before it.
#pragma once

#include "kernels/cuda/cuda.h"
#include "kernels/sort/digit_plan_cuda.h"

namespace gs {

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
/// A block waits for those before it. Blocks start in the order of their indices, so these run or have ended; and no
/// block waits before it has told its own sum.
template <int kColumns> class BlockSums {
  public:
    /// The largest sum of a block. The word of a group has 20 bits for those of its blocks.
    static constexpr std::uint32_t kMostSum = ((1u << 20) - 1) / kBlocksOfGroup;

    /// words: block_sums(gridDim.x, kColumns) of them, 0 before.
    __device__ explicit BlockSums(std::uint32_t* words)
        : blocks_(words), groups_(words + std::size_t(gridDim.x) * kColumns) {}

    /// Tells the blocks behind this one its sum in a column.
    __device__ void tell(int column, std::uint32_t sum) const {
        // Relaxed: nothing else is told by it.
        asm volatile("st.relaxed.gpu.u32 [%0], %1;" ::"l"(block(blockIdx.x) + column), "r"(kTold | sum) : "memory");
        if (own_group() < num_groups()) atomicAdd(group(own_group()) + column, kOneBlock + sum);
    }

    /// Returns for column threadIdx.x the sum over all blocks before this one, whose own sum in that column is given.
    /// All threads of the block call it. Sets of threads read four columns of some words each, many words at once.
    template <int kThreads> __device__ std::uint32_t before(std::uint32_t own_sum, uint4 (&found)[kThreads]) const {
        constexpr int kFours = kColumns / 4, kReaders = kThreads / kFours, kAhead = 4;
        const int reader = int(threadIdx.x) / kFours, four = int(threadIdx.x) % kFours;
        // First the words of the blocks before this one in its group, then those of the groups before, backwards. The
        // last block of a group waits for the whole group instead, whose word it will replace.
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
    // A block's word is its sum with kTold. The word of a group has the sum of its blocks in the lower bits and their
    // number from kOneBlock on. Once it is whole, its last block replaces it by the sum over all blocks up to there,
    // with kAll.
    static constexpr std::uint32_t kTold = 1u << 31, kAll = 1u << 31, kOneBlock = 1u << 20,
                                   kWholeGroup = kBlocksOfGroup * kOneBlock;

    __device__ std::uint32_t* block(int b) const { return blocks_ + std::size_t(b) * kColumns; }
    __device__ std::uint32_t* group(int g) const { return groups_ + std::size_t(g) * kColumns; }
    __device__ static int own_group() { return int(blockIdx.x) / kBlocksOfGroup; }
    __device__ static int num_groups() { return int(gridDim.x) / kBlocksOfGroup; }  ///< whole ones

    std::uint32_t *blocks_, *groups_;
};

}  // namespace gs
