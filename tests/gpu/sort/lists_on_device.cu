// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/sort/lists_on_device.h"

#include "kernels/engines/wire_splats_cuda.h"

namespace gs::test {
namespace {

static_assert(kTileX == kCudaTileX && kTileY == kCudaTileY);

__global__ void note_first_parts(const TileItem* items, int num, std::uint32_t* tiles) {
    for (int k = 0; k < num; ++k) tiles[k] = items[k].is_first_of_tile() ? std::uint32_t(items[k].tile()) : ~0u;
}

}  // namespace

ListsOnDevice list_on_device(const std::vector<WireSplat>& splats, int width, int height, std::int64_t room,
                             bool with_slots) {
    const auto n = std::int64_t(splats.size());
    CudaBinning binning;
    PackedSplat* packed = nullptr;
    Scratch scratch;
    scratch.carve([&](Carver& c) {
        packed = c.take<PackedSplat>(n);
        binning.take_results(c, n, room, width, height, with_slots);
        binning.take_temporaries(c);
    });
    // Nobody may count on memory that happens to be 0.
    GS_CUDA(cudaMemset(packed, 0xff, std::size_t(scratch.bytes())));
    DeviceBuffer<uint4> zeros;
    constexpr std::size_t kZeros = 10'000;
    GS_CUDA(cudaMemset(zeros.reserve(kZeros), 0xff, kZeros * sizeof(uint4)));
    DeviceBuffer<StepControl> control;
    GS_CUDA(cudaMemset(control.reserve(1), 0xff, sizeof(StepControl)));
    GS_CUDA(cudaMemset(&control.get()->stopped, 0, sizeof(unsigned)));
    DeviceBuffer<WireSplat> wire;
    wire.upload(splats);
    const auto padded = [](int size, int tile) { return (size + tile - 1) / tile * tile; };
    unpack_splats(wire.get(), n, 0,
                  {{}, padded(width, kCudaTileX), padded(height, kCudaTileY), DepthKey::of(0.01f, 1e4f), 255}, packed,
                  nullptr, binning.input(), control.get(), nullptr);
    const auto download = [](const std::uint32_t* from, std::int64_t num) {
        std::vector<std::uint32_t> out(static_cast<std::size_t>(num));
        GS_CUDA(cudaMemcpy(out.data(), from, out.size() * sizeof(std::uint32_t), cudaMemcpyDeviceToHost));
        return out;
    };
    ListsOnDevice out{};
    out.counts = download(binning.input().counts, n);
    out.depths = download(binning.input().depth_keys, n);  // the sort overwrites them
    for (std::uint32_t& key : out.depths) key &= (1u << kDepthKeyBits) - 1;
    const CudaBins bins = binning.build(packed, room, {zeros.get(), kZeros}, control.get(), nullptr);
    DeviceBuffer<std::uint32_t> tiles;
    note_first_parts<<<1, 1>>>(bins.longest_first, bins.num_items(), tiles.reserve(bins.num_items()));
    GS_CUDA_LAUNCHED("note_first_parts");
    const StepControl counted = control.download(1)[0];
    out.num_instances = counted.num_instances, out.stopped = counted.stopped != 0;
    out.num_visible = counted.num_visible;
    out.cleared = true;
    for (const uint4& four : zeros.download(kZeros)) out.cleared &= !(four.x | four.y | four.z | four.w);
    out.offsets = download(bins.tile_offsets, bins.num_tiles() + 1);
    const std::int64_t listed = out.offsets.back();
    out.instances = download(bins.instances, listed);
    if (with_slots) {
        out.gaussians = download(bins.gaussians, listed);
        out.order = download(binning.slots().order, counted.num_visible);
        out.slot_ends = download(binning.slots().slot_ends, n);
    }
    for (const std::uint32_t tile : tiles.download(bins.num_items()))
        if (tile != ~0u) out.tiles_worked_on.push_back(tile);
    return out;
}

}  // namespace gs::test
