// SPDX-License-Identifier: Apache-2.0
// How a radix sort on the device cuts keys into digits, and the scratch words that this takes.
#pragma once

#include <cstddef>
#include <cstdint>

namespace gs {

inline constexpr int kSweepBlock = 256, kSweepItems = 16, kSweepPairs = kSweepBlock * kSweepItems;

/// The number of blocks whose sums are added up in one word, too (BlockSums): with 16, a few hundred blocks are about
/// as many groups as a group has blocks, and a block reads few words of each kind.
inline constexpr int kBlocksOfGroup = 16;
/// Returns the number of words by which blocks tell one another their sums in some columns.
constexpr std::size_t block_sums(std::size_t blocks, int columns) {
    return (blocks + blocks / kBlocksOfGroup) * std::size_t(columns);
}

/// The passes of a sort.
struct DigitPlan {
    int passes, bits;  ///< bits of a digit: 7 or 8

    /// Returns the plan for keys of up to 32 bits. Fewer digits are fewer sums to tell other blocks.
    static constexpr DigitPlan of(int key_bits) {
        return key_bits <= 14 ? DigitPlan{2, 7} : DigitPlan{(key_bits + 7) / 8, 8};
    }
    constexpr int digits() const { return 1 << bits; }
    /// Returns the number of counts of all passes.
    constexpr int counts() const { return passes << bits; }
    /// Returns the number of words by which the blocks of one pass tell one another their sums.
    std::size_t sums(std::int64_t pairs) const {
        return block_sums(std::size_t(pairs + kSweepPairs - 1) / kSweepPairs, digits());
    }
};

}  // namespace gs
