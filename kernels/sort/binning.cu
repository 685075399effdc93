// SPDX-License-Identifier: Apache-2.0
#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

#include "kernels/sort/binning_cuda.h"

namespace gs {
namespace {

constexpr int kBlock = 256;

/// Counting and writing must agree bit for bit about every tile, or slots stay unwritten: one copy of the code.
__device__ __noinline__ bool touches(const Splat<float>& s, int tx, int ty) {
    const float power = min_power_in_rectangle(s, float(tx * kCudaTileX), float(ty * kCudaTileY), float(kCudaTileX - 1), float(kCudaTileY - 1));
    return power <= touch_threshold(s);
}

struct TileRectangle {
    int x0, x1, y0, y1;
    __device__ explicit TileRectangle(const SplatBounds& b)
        : x0(b.x_min / kCudaTileX), x1((b.x_max + kCudaTileX - 1) / kCudaTileX), y0(b.y_min / kCudaTileY), y1((b.y_max + kCudaTileY - 1) / kCudaTileY) {}
    __device__ int width() const { return x1 - x0; }
    __device__ int size() const { return (x1 - x0) * (y1 - y0); }
};

/// Tiles of a Gaussian that its own lane tests; the rest is shared by the warp.
constexpr int kSequential = 4;

/// The Gaussians of a warp, one per lane: each lane tests up to 4 tiles of its own, what is left of the large ones the
/// whole warp does together. emit(lane, tile, k): the k-th touched tile of that lane's Gaussian.
template <class Emit>
__device__ int for_touched_tiles(const Splat<float>* splats, const SplatBounds* bounds, std::uint32_t gaussian, bool valid, int tiles_x, Emit emit) {
    const unsigned lane = threadIdx.x & 31;
    const SplatBounds b = valid ? bounds[gaussian] : SplatBounds{0, 0, 0, 0};
    const TileRectangle r(b);
    const int candidates = valid && b.x_max > b.x_min && b.y_max > b.y_min ? r.size() : 0;
    int count = 0;
    if (candidates > 0) {
        const Splat<float> s = splats[gaussian];
        for (int k = 0; k < min(candidates, kSequential); ++k) {
            const int tx = r.x0 + k % r.width(), ty = r.y0 + k / r.width();
            if (touches(s, tx, ty)) emit(int(lane), ty * tiles_x + tx, count++);
        }
    }
    unsigned large = __ballot_sync(~0u, candidates > kSequential);
    while (large) {
        const int owner = __ffs(large) - 1;
        large &= large - 1;
        const std::uint32_t g = __shfl_sync(~0u, gaussian, owner);
        const int n = __shfl_sync(~0u, candidates, owner);
        int done = __shfl_sync(~0u, count, owner);
        const Splat<float> s = splats[g];
        const TileRectangle q(bounds[g]);
        for (int base = kSequential; base < n; base += 32) {
            const int k = base + int(lane);
            const int tx = q.x0 + k % q.width(), ty = q.y0 + k / q.width();
            const bool hit = k < n && touches(s, tx, ty);
            const unsigned hits = __ballot_sync(~0u, hit);
            if (hit) emit(owner, ty * tiles_x + tx, done + __popc(hits & ((1u << lane) - 1)));
            done += __popc(hits);
        }
        if (int(lane) == owner) count = done;
    }
    return count;
}

__global__ void fill_indices(std::uint32_t n, std::uint32_t* indices) {
    const std::uint32_t i = blockIdx.x * kBlock + threadIdx.x;
    if (i < n) indices[i] = i;
}

/// Also empties the bounds of a Gaussian that touches no tile: it counts as culled from here on.
__global__ void count_tiles(std::uint32_t n, const std::uint32_t* order, const Splat<float>* splats, SplatBounds* bounds, int tiles_x,
                            std::uint32_t* counts) {
    const std::uint32_t k = blockIdx.x * kBlock + threadIdx.x;
    const bool valid = k < n;
    const int count = for_touched_tiles(splats, bounds, valid ? order[k] : 0, valid, tiles_x, [](int, int, int) {});
    if (!valid) return;
    counts[k] = count;
    if (count == 0) bounds[order[k]] = {0, 0, 0, 0};
}

__global__ void write_instances(std::uint32_t n, const std::uint32_t* order, const Splat<float>* splats, const SplatBounds* bounds, int tiles_x,
                                const std::uint64_t* offsets, std::uint32_t* tile_keys, std::uint32_t* instances) {
    const std::uint32_t k = blockIdx.x * kBlock + threadIdx.x;
    const bool valid = k < n;
    const std::uint32_t gaussian = valid ? order[k] : 0;
    const std::uint64_t offset = valid && k > 0 ? offsets[k - 1] : 0; // inclusive scan
    for_touched_tiles(splats, bounds, gaussian, valid, tiles_x, [&](int owner, int tile, int rank) {
        // In the shared phase the emitting lane is not the owner; both values come from the owner's slot range.
        const std::uint32_t owner_k = k - (threadIdx.x & 31) + owner;
        const std::uint64_t at = (owner_k == k ? offset : (owner_k > 0 ? offsets[owner_k - 1] : 0)) + rank;
        tile_keys[at] = tile;
        instances[at] = order[owner_k];
    });
}

__global__ void find_tile_offsets(std::uint32_t num_instances, const std::uint32_t* tiles, std::uint32_t num_tiles, std::uint32_t* offsets) {
    // offsets[t] = first instance with tile >= t: the thread at a change of tile fills all tiles in between.
    const std::uint32_t i = blockIdx.x * kBlock + threadIdx.x;
    if (i > num_instances) return;
    const std::uint32_t from = i == 0 ? 0 : tiles[i - 1] + 1, to = i == num_instances ? num_tiles : tiles[i];
    for (std::uint32_t t = from; t <= to; ++t) offsets[t] = i;
}

__global__ void count_buckets(std::uint32_t num_tiles, const std::uint32_t* offsets, std::uint32_t* counts) {
    const std::uint32_t t = blockIdx.x * kBlock + threadIdx.x;
    if (t <= num_tiles) counts[t] = t < num_tiles ? (offsets[t + 1] - offsets[t] + kBucket - 1) / kBucket : 0;
}

}  // namespace

CudaBinning::~CudaBinning() { cudaFreeHost(total_); }

CudaBins CudaBinning::build(std::int64_t n, const Splat<float>* splats, SplatBounds* bounds, const std::uint32_t* depth_keys, int width, int height,
                            cudaStream_t stream) {
    CudaBins bins;
    bins.tiles_x = (width + kCudaTileX - 1) / kCudaTileX;
    bins.tiles_y = (height + kCudaTileY - 1) / kCudaTileY;
    const std::uint32_t num_tiles = std::uint32_t(bins.tiles_x) * bins.tiles_y, count = std::uint32_t(n);
    if (!total_) GS_CUDA(cudaMallocHost(&total_, sizeof *total_));
    *total_ = 0;
    const auto with_workspace = [&](auto&& call) {
        std::size_t bytes = 0;
        GS_CUDA(call(nullptr, bytes));
        void* memory = workspace_.reserve(bytes);
        GS_CUDA(call(memory, bytes));
    };
    if (n > 0) {
        std::uint32_t *indices = indices_.reserve(n), *keys = sorted_keys_.reserve(n), *order = sorted_indices_.reserve(n), *counts = counts_.reserve(n);
        std::uint64_t* offsets = offsets_.reserve(n);
        fill_indices<<<num_blocks(n, kBlock), kBlock, 0, stream>>>(count, indices);
        GS_CUDA_LAUNCHED("fill_indices");
        with_workspace([&](void* m, std::size_t& b) { return cub::DeviceRadixSort::SortPairs(m, b, depth_keys, keys, indices, order, int(n), 0, 32, stream); });
        count_tiles<<<num_blocks(n, kBlock), kBlock, 0, stream>>>(count, order, splats, bounds, bins.tiles_x, counts);
        GS_CUDA_LAUNCHED("count_tiles");
        with_workspace([&](void* m, std::size_t& b) {
            return cub::DeviceScan::InclusiveScan(m, b, counts, offsets, cuda::std::plus<std::uint64_t>{}, int(n), stream);
        });
        GS_CUDA(cudaMemcpyAsync(total_, offsets + n - 1, sizeof *total_, cudaMemcpyDeviceToHost, stream));
        GS_CUDA(cudaStreamSynchronize(stream));
    }
    if (*total_ > 0x7fffffffull)
        throw DeviceError("more than 2147483647 Gaussian-tile instances in one view (" + std::to_string(*total_) +
                          "); likely cause: many Gaussians larger than the image. Lower --cap-max, raise --scale-reg or render at a lower --resolution");
    bins.num_instances = std::int64_t(*total_);
    std::uint32_t *tile_offsets = tile_offsets_.reserve(num_tiles + 1), *bucket_counts = bucket_counts_.reserve(num_tiles + 1),
                  *bucket_offsets = bucket_offsets_.reserve(num_tiles + 1);
    const std::uint32_t total = std::uint32_t(*total_);
    std::uint32_t *tiles = tile_keys_.reserve(total + 1), *sorted_tiles = sorted_tiles_.reserve(total + 1), *instances = instances_.reserve(total + 1),
                  *sorted = sorted_instances_.reserve(total + 1);
    if (total > 0) {
        write_instances<<<num_blocks(n, kBlock), kBlock, 0, stream>>>(count, sorted_indices_.get(), splats, bounds, bins.tiles_x, offsets_.get(), tiles, instances);
        GS_CUDA_LAUNCHED("write_instances");
        int bits = 1;
        while ((std::uint64_t(1) << bits) < num_tiles) ++bits;
        with_workspace([&](void* m, std::size_t& b) { return cub::DeviceRadixSort::SortPairs(m, b, tiles, sorted_tiles, instances, sorted, int(total), 0, bits, stream); });
    }
    find_tile_offsets<<<num_blocks(std::int64_t(total) + 1, kBlock), kBlock, 0, stream>>>(total, sorted_tiles, num_tiles, tile_offsets);
    GS_CUDA_LAUNCHED("find_tile_offsets");
    count_buckets<<<num_blocks(std::int64_t(num_tiles) + 1, kBlock), kBlock, 0, stream>>>(num_tiles, tile_offsets, bucket_counts);
    GS_CUDA_LAUNCHED("count_buckets");
    with_workspace([&](void* m, std::size_t& b) { return cub::DeviceScan::ExclusiveSum(m, b, bucket_counts, bucket_offsets, int(num_tiles + 1), stream); });
    bins.instances = sorted;
    bins.tile_offsets = tile_offsets;
    bins.bucket_offsets = bucket_offsets;
    // Every tile wastes less than one bucket.
    bins.max_buckets = bins.num_instances / kBucket + num_tiles;
    return bins;
}

}  // namespace gs
