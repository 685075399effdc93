// SPDX-License-Identifier: Apache-2.0
// Packs and unpacks one splat per thread. Tiles are found by the same code with the same flags as in preprocessing, so
// they agree except for the rounding of a conic that was scaled and scaled back.
#include "kernels/engines/wire_splats_cuda.h"

#include <algorithm>

#include "kernels/preprocess/gaussian_device.h"
#include "kernels/sort/place_splat_cuda.cuh"

namespace gs {
namespace {

constexpr int kWireBlock = 128;

/// Writes the values of a block's first `num` threads word by word, so that neighbouring threads write neighbouring
/// words. All threads of the block call it.
template <class T> __device__ void write_in_a_row(T* out, int num, const T& value) {
    constexpr int kWords = sizeof(T) / sizeof(std::uint32_t);
    __shared__ alignas(T) std::uint32_t words[kWireBlock * kWords];
    if (int(threadIdx.x) < num) reinterpret_cast<T*>(words)[threadIdx.x] = value;
    __syncthreads();
    auto* to = reinterpret_cast<std::uint32_t*>(out);
    for (int w = threadIdx.x; w < num * kWords; w += kWireBlock) to[w] = words[w];
}

/// Returns the number of a block's threads that have one of `num` values.
__device__ int num_of_block(std::int64_t num) {
    const std::int64_t left = num - std::int64_t(blockIdx.x) * kWireBlock;
    return int(left < 0 ? 0 : left < kWireBlock ? left : kWireBlock);
}

__device__ std::int64_t wire_index() { return std::int64_t(blockIdx.x) * kWireBlock + threadIdx.x; }

__global__ void __launch_bounds__(kWireBlock)
    pack(const std::uint32_t* __restrict__ rows, const std::int64_t* __restrict__ num, ParameterView<float> params,
         CameraParams<float> camera, const PackedSplat* __restrict__ splats,
         const PackedLensShape* __restrict__ lens_shapes, WireSplats out) {
    const std::int64_t k = wire_index();
    if (k == 0 && out.report) *out.report = {{}, *num, *num > out.room, 0};
    WireSplat wire{};
    const bool exists = k < *num && k < out.room;
    const unsigned existing = __ballot_sync(~0u, exists);
    if (exists) {
        const std::uint32_t row = rows[k];
        const PackedSplat splat = splats[row];
        const float depth = depth_of(camera_point(params.mean(row), camera), camera);
        wire = lens_shapes ? WireSplat::of(splat.splat(), lens_shapes[row].shape(), depth)
                           : WireSplat::of(splat.splat(), splat.bounds(), depth);
        if (out.rows) out.rows[k] = row;
        if (out.places) {
            const std::uint32_t group = row / 32;
            const unsigned lanes = __match_any_sync(existing, group);
            const unsigned shown = __reduce_or_sync(lanes, 1u << (row % 32));
            // Rows ascend, so that a group ends in this warp or continues in the next.
            if (int(threadIdx.x % 32) == __ffs(lanes) - 1) atomicOr(&out.places[group].shown, shown);
            if (k == 0 || rows[k - 1] / 32 != group) out.places[group].first = std::uint32_t(k);
        }
    }
    write_in_a_row(out.splats + (k - threadIdx.x), num_of_block(out.room), wire);
}

__global__ void __launch_bounds__(kWireBlock)
    unpack(const WireSplat* __restrict__ wire, std::int64_t num, std::int64_t first, WireView view,
           PackedSplat* __restrict__ splats, PackedLensShape* __restrict__ lens_shapes, CudaBinningInput out,
           StepControl* __restrict__ control) {
    begin_view(out, control);
    const std::int64_t k = wire_index();
    const bool exists = k < num;
    WireSplat mine{};
    Splat<float> s{};
    PixelBounds b{0, 0, 0, 0};
    if (exists) mine = wire[k];
    if (mine.opacity > 0) {  // others pad the array
        LensShape<float> shape;
        s = received_splat(mine, view.camera, view.width_padded, view.height_padded, view.inverse_alpha, b, &shape);
        if (lens_shapes) lens_shapes[first + k] = PackedLensShape::of(shape);
    }
    const TileTest tiles = test_tiles(s, b, b.x_max > b.x_min && b.y_max > b.y_min, view.width_padded / kCudaTileX);
    if (exists) place_splat(first + k, s, b, tiles, view.depth_key, mine.depth, splats, out);
}

/// Writes the splats of rank `rank` to their places among the splats of all ranks.
__global__ void __launch_bounds__(kWireBlock)
    merge(const SplatsOfRank* __restrict__ parts, int num_ranks, int rank, WireSplat* __restrict__ out) {
    const std::int64_t k = wire_index();
    if (k < parts[rank].num) out[place_in_order(parts, num_ranks, rank, k)] = parts[rank].splats[k];
}

__global__ void __launch_bounds__(kWireBlock)
    pack(const PackedSums* __restrict__ sums, std::int64_t num, SplatSums<float>* __restrict__ out) {
    const std::int64_t k = wire_index();
    write_in_a_row(out + (k - threadIdx.x), num_of_block(num), k < num ? sums[k].sums() : SplatSums<float>{});
}

}  // namespace

void pack_splats(const std::uint32_t* rows, const std::int64_t* num, const ParameterView<float>& params,
                 const CameraParams<float>& camera, const PackedSplat* splats, const PackedLensShape* lens_shapes,
                 const WireSplats& out, cudaStream_t stream) {
    const unsigned blocks = std::max(1u, num_blocks(out.room, kWireBlock));
    pack<<<blocks, kWireBlock, 0, stream>>>(rows, num, params, camera, splats, lens_shapes, out);
    GS_CUDA_LAUNCHED("pack");
}

void unpack_splats(const WireSplat* wire, std::int64_t num, std::int64_t first, const WireView& view,
                   PackedSplat* splats, PackedLensShape* lens_shapes, const CudaBinningInput& out, StepControl* control,
                   cudaStream_t stream) {
    if (num == 0) return;
    unpack<<<num_blocks(num, kWireBlock), kWireBlock, 0, stream>>>(wire, num, first, view, splats, lens_shapes, out,
                                                                   control);
    GS_CUDA_LAUNCHED("unpack");
}

void merge_splats(const std::vector<SplatsOfRank>& parts, const SplatsOfRank* parts_on_device, WireSplat* out,
                  cudaStream_t stream) {
    for (std::size_t rank = 0; rank < parts.size(); ++rank) {
        if (parts[rank].num == 0) continue;
        merge<<<num_blocks(parts[rank].num, kWireBlock), kWireBlock, 0, stream>>>(parts_on_device, int(parts.size()),
                                                                                  int(rank), out);
        GS_CUDA_LAUNCHED("merge");
    }
}

void pack_sums(const PackedSums* sums, std::int64_t num, SplatSums<float>* out, cudaStream_t stream) {
    if (num == 0) return;
    pack<<<num_blocks(num, kWireBlock), kWireBlock, 0, stream>>>(sums, num, out);
    GS_CUDA_LAUNCHED("pack");
}

}  // namespace gs
