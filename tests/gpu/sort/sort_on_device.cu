// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/sort/sort_on_device.h"

#include <algorithm>

#include "kernels/cuda/device_memory.h"
#include "kernels/sort/radix_cuda.cuh"

namespace gs::test {

static_assert(kPairsOfChunk == ChunkSums::kPairs);
static_assert(kPairsOfGroup == ChunkSums::kPairs * ChunkSums::kChunksOfGroup);

template <class Key>
SortedOnDevice sort_on_device(const std::vector<Key>& keys, int bits, std::uint32_t least, std::int64_t room,
                              const std::vector<std::uint32_t>& tiles) {
    const DigitPlan plan = DigitPlan::of(bits);
    std::vector<std::uint32_t> counts(std::size_t(plan.counts()));
    std::int64_t kept = 0;
    for (const std::uint32_t key : keys) {
        if (key < least) continue;
        ++kept;
        for (int p = 0; p < plan.passes; ++p)
            ++counts[std::size_t(p << plan.bits | int(key >> p * plan.bits & ((1u << plan.bits) - 1)))];
    }
    std::vector<StepControl> host_control(1);
    host_control[0].num_instances = keys.size();
    host_control[0].num_visible = unsigned(kept);
    DeviceBuffer<StepControl> control;
    control.upload(host_control);

    DeviceBuffer<Key> device_keys[2];
    DeviceBuffer<std::uint32_t> values[2], device_counts, sums;
    std::vector<Key> padded_keys = keys;
    padded_keys.resize(std::size_t(room), Key(1));  // what lies behind the pairs is not read
    device_keys[0].upload(padded_keys), device_counts.upload(counts);
    device_keys[1].reserve(room);
    for (auto& v : values) GS_CUDA(cudaMemset(v.reserve(room), 0xff, std::size_t(room) * sizeof(std::uint32_t)));
    const std::size_t words = std::max<std::size_t>(plan.passes * plan.sums(room), 1);
    GS_CUDA(cudaMemset(sums.reserve(words), 0, words * sizeof(std::uint32_t)));

    // As for depths and for instances.
    const bool culls = least > 0;
    const NumPairs all{culls ? NumPairs::kAll : NumPairs::kInstances, std::uint32_t(room), control.get()};
    const NumPairs kept_pairs{culls ? NumPairs::kVisible : NumPairs::kInstances, std::uint32_t(room), control.get()};
    const unsigned groups = num_blocks(room, ChunkSums::kPairs * ChunkSums::kChunksOfGroup);
    DeviceBuffer<std::uint32_t> device_tiles, chunk_sums;
    ChunkSums sums_of_tiles;
    if (!tiles.empty()) {
        device_tiles.upload(tiles);
        const std::size_t chunks = groups * ChunkSums::kChunksOfGroup;
        GS_CUDA(cudaMemset(chunk_sums.reserve(chunks + groups), 0, (chunks + groups) * sizeof(std::uint32_t)));
        sums_of_tiles = {device_tiles.get(), chunk_sums.get(), chunk_sums.get() + chunks};
    }
    DeviceBuffer<std::uint32_t> begins;
    GS_CUDA(cudaMemset(begins.reserve(kMostNotedKey + 1), 0, (kMostNotedKey + 1) * sizeof(std::uint32_t)));
    const KeyBegins noted{culls ? nullptr : begins.get(), kMostNotedKey};
    sort_pairs(plan, RadixPairs<Key>{{device_keys[0].get(), device_keys[1].get()}, {values[0].get(), values[1].get()}},
               true, device_counts.get(), sums.get(), all, kept_pairs, {least, sums_of_tiles, noted}, nullptr);
    GS_CUDA(cudaDeviceSynchronize());
    SortedOnDevice out{
        values[plan.passes % 2].download(std::min(kept, room)), begins.download(kMostNotedKey + 1), {}, {}};
    for (std::uint32_t& begin : out.begins) begin = ~begin;
    if (!tiles.empty()) {
        out.chunk_sums = chunk_sums.download(groups * (ChunkSums::kChunksOfGroup + 1));
        out.group_sums.assign(out.chunk_sums.end() - groups, out.chunk_sums.end());
        out.chunk_sums.resize(groups * ChunkSums::kChunksOfGroup);
    }
    return out;
}

template SortedOnDevice sort_on_device(const std::vector<std::uint16_t>&, int, std::uint32_t, std::int64_t,
                                       const std::vector<std::uint32_t>&);
template SortedOnDevice sort_on_device(const std::vector<std::uint32_t>&, int, std::uint32_t, std::int64_t,
                                       const std::vector<std::uint32_t>&);

}  // namespace gs::test
