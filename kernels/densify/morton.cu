// SPDX-License-Identifier: Apache-2.0
// Sorts the rows into Morton order on the device.
#include <thrust/iterator/transform_iterator.h>

#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_reduce.cuh>

#include "kernels/densify/densify_cuda.h"
#include "kernels/densify/rows_cuda.h"
#include "kernels/densify/rows_device.h"

namespace gs {
namespace {

struct BoundsOfRow {
    const float* means;
    __host__ __device__ MeanBounds operator()(std::uint32_t i) const {
        MeanBounds bounds;
        bounds.add(means + 3 * std::int64_t(i));
        return bounds;
    }
};

struct BoundsUnion {
    __host__ __device__ MeanBounds operator()(MeanBounds a, const MeanBounds& b) const {
        a.add(b);
        return a;
    }
};

__global__ void write_codes(std::int64_t n, const float* means, const MeanBounds* bounds, std::uint64_t* codes,
                            std::uint32_t* order) {
    const std::int64_t i = thread_row();
    if (i >= n) return;
    codes[i] = morton_code(means + 3 * i, *bounds);
    order[i] = std::uint32_t(i);
}

}  // namespace

void CudaDensify::morton_sort() {
    const std::int64_t n = model_.count, block = scratch_.bytes();
    if (n < 2) return;
    CudaResidualHandles residuals(model_, stream_);
    const float* means = model_.param[int(Group::kMean)].get();
    MeanBounds* bounds = nullptr;
    std::uint32_t* order[2] = {};
    std::uint64_t* codes[2] = {};
    CubSpace cub;
    RowSlice slice;
    const auto reduce = [&](void* m, std::size_t& b) {
        return cub::DeviceReduce::Reduce(m, b, thrust::make_transform_iterator(row_indices(), BoundsOfRow{means}),
                                         bounds, n, BoundsUnion{}, MeanBounds{}, stream_);
    };
    cub::DoubleBuffer<std::uint64_t> keys;
    cub::DoubleBuffer<std::uint32_t> rows;
    // The sort is stable: equal codes keep their order, as on the CPU.
    const auto sort = [&](void* m, std::size_t& b) {
        return cub::DeviceRadixSort::SortPairs(m, b, keys, rows, n, 0, 63, stream_);
    };
    cub.ask(reduce), cub.ask(sort);
    scratch_.carve([&](Carver& c) {
        for (auto& half : order) half = c.take<std::uint32_t>(n);
        const std::size_t sorted = c.at();
        for (auto& half : codes) half = c.take<std::uint64_t>(n);
        bounds = c.take<MeanBounds>(1);
        cub.take(c);
        c.rewind(sorted);
        slice = take_slice(c, model_, n, block);
    });
    cub.run(reduce);
    write_codes<<<num_blocks(n, kRowBlock), kRowBlock, 0, stream_>>>(n, means, bounds, codes[0], order[0]);
    GS_CUDA_LAUNCHED("write_codes");
    keys = {codes[0], codes[1]}, rows = {order[0], order[1]};
    cub.run(sort);
    gather_rows(model_, rows.Current(), n, n, slice, stream_);
    GS_CUDA(cudaStreamSynchronize(stream_));
    residuals.resolve(scratch_);
}

}  // namespace gs
