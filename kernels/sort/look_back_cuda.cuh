// SPDX-License-Identifier: Apache-2.0
// Sums over the blocks before a block, which the blocks of a kernel tell one another (Merrill and Garland 2016,
// "decoupled look-back").
#pragma once

#include "kernels/cuda/cuda.h"

namespace gs {

// A block waits for those before it. Blocks start in the order of their indices, so these run or have ended; and no
// block waits before it has told its own sum.
//
// A word is 0 while nothing is known of its block. With the top bit set, the rest is the block's own sum. Otherwise it
// is 1 more than the sum over all blocks up to this one. A sum of 2^31 - 1, the most that there can be, does not fit,
// but only the last block has it, whose word nobody reads.

/// Tells the blocks behind this one its own sum, or the sum over all blocks up to it.
__device__ inline void publish_sum(std::uint32_t* word, std::uint32_t sum, bool over_all) {
    asm volatile("st.relaxed.gpu.u32 [%0], %1;" ::"l"(word), "r"(over_all ? sum + 1 : 0x80000000u | sum) : "memory");
}
__device__ inline bool is_over_all(std::uint32_t word) { return !(word >> 31); }
__device__ inline std::uint32_t sum_of_word(std::uint32_t word) {
    return is_over_all(word) ? word - 1 : word & 0x7fffffffu;
}

/// Returns the sum over the lanes up to this one.
__device__ inline std::uint32_t inclusive_sum(std::uint32_t x) {
#pragma unroll
    for (int d = 1; d < 32; d *= 2) {
        const std::uint32_t other = __shfl_up_sync(~0u, x, d);
        if (int(threadIdx.x & 31) >= d) x += other;
    }
    return x;
}

/// Returns for column threadIdx.x the sum over all blocks before this one; all threads of the block call it. words:
/// (blocks, kColumns). Groups of threads read four columns of some blocks each, many words at once.
template <int kColumns, int kThreads>
__device__ std::uint32_t look_back(const std::uint32_t* words, uint4 (&found)[kThreads]) {
    constexpr int kFours = kColumns / 4, kGroups = kThreads / kFours, kAhead = 4;
    const int group = int(threadIdx.x) / kFours, four = int(threadIdx.x) % kFours;
    const auto read = [&](int block) {
        uint4 w;
        asm volatile("ld.relaxed.gpu.v4.u32 {%0,%1,%2,%3}, [%4];"
                     : "=r"(w.x), "=r"(w.y), "=r"(w.z), "=r"(w.w)
                     : "l"(words + std::size_t(block) * kColumns + 4 * four)
                     : "memory");
        return w;
    };
    std::uint32_t sum = 0;
    bool open = threadIdx.x < kColumns;
    for (int last = int(blockIdx.x) - 1; last >= 0; last -= kGroups * kAhead) {
        const int from = last - group * kAhead;
        uint4 w[kAhead];
#pragma unroll
        for (int u = 0; u < kAhead; ++u) w[u] = from - u >= 0 ? read(from - u) : make_uint4(1, 1, 1, 1);
        std::uint32_t s[4] = {};
        bool done[4] = {};
#pragma unroll
        for (int u = 0; u < kAhead; ++u) {
            while (!(w[u].x && w[u].y && w[u].z && w[u].w)) w[u] = read(from - u);
            const std::uint32_t of[4] = {w[u].x, w[u].y, w[u].z, w[u].w};
#pragma unroll
            for (int c = 0; c < 4; ++c)
                if (!done[c]) s[c] += sum_of_word(of[c]), done[c] = is_over_all(of[c]);
        }
        const auto note = [&](int c) { return s[c] | (done[c] ? 0x80000000u : 0); };
        found[threadIdx.x] = make_uint4(note(0), note(1), note(2), note(3));
        __syncthreads();
        for (int g = 0; g < kGroups && open; ++g) {
            const std::uint32_t x = reinterpret_cast<const std::uint32_t*>(found)[g * kColumns + threadIdx.x];
            sum += x & 0x7fffffffu;
            open = !(x >> 31);
        }
        if (!__syncthreads_or(open)) break;
    }
    return sum;
}

}  // namespace gs
