// SPDX-License-Identifier: Apache-2.0
// kernels/sort/radix_cuda.cuh for host code.
#pragma once

#include <cstdint>
#include <vector>

namespace gs::test {

inline constexpr std::uint32_t kPairsOfChunk = 512, kPairsOfGroup = 4 * kPairsOfChunk, kUntouchedValue = 0xffffffff,
                               kMostNotedKey = 20'000, kNoPlace = 0xffffffff;

struct SortedOnDevice {
    std::vector<std::uint32_t> values, begins, chunk_sums, group_sums;
};

/// Sorts the positions of keys by their lower `bits` bits, without those whose key is below `least`. The device takes
/// the number of pairs from a StepControl, and there is room for `room` of them. Where `tiles` is given, the last pass
/// also adds up the tiles of chunks and groups of sorted keys: what keys have above 24 bits, or tiles[position] for
/// 255. The result has `room` values at most, and kUntouchedValue where none was written. Where nothing is left out, it
/// also has the places at which keys begin, kNoPlace for those that do not occur; keys from kMostNotedKey on count as
/// this one.
template <class Key>
SortedOnDevice sort_on_device(const std::vector<Key>& keys, int bits, std::uint32_t least, std::int64_t room,
                              const std::vector<std::uint32_t>& tiles = {});

}  // namespace gs::test
