// SPDX-License-Identifier: Apache-2.0
// kernels/sort/radix_cuda.cuh for host code.
#pragma once

#include <cstdint>
#include <vector>

namespace gs::test {

inline constexpr std::uint32_t kPairsOfChunk = 512, kPairsOfGroup = 4 * kPairsOfChunk, kUntouchedValue = 0xffffffff;

template <class Key> struct SortedOnDevice {
    std::vector<Key> keys;
    std::vector<std::uint32_t> values, chunk_sums, group_sums;
};

/// Sorts the positions of keys by their lower `bits` bits, without those whose key is below `least`. The device takes
/// the number of pairs from a StepControl, and there is room for `room` of them. Where `tiles` is given, the last pass
/// also adds up the tiles of chunks and groups of sorted keys: what keys have above 24 bits, or tiles[position] for
/// 255. The result has `room` values at most, and kUntouchedValue where none was written.
template <class Key>
SortedOnDevice<Key> sort_on_device(const std::vector<Key>& keys, int bits, std::uint32_t least, std::int64_t room,
                                   const std::vector<std::uint32_t>& tiles = {});

}  // namespace gs::test
