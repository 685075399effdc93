// SPDX-License-Identifier: Apache-2.0
// Row operations on the device: gather and pruning.
#include "kernels/densify/densify_cuda.h"
#include "kernels/densify/rows_cuda.h"
#include "kernels/densify/rows_device.h"

namespace gs {
namespace {

/// The old row of each new row.
struct InOrder {
    const std::uint32_t* order;
    __device__ std::int64_t operator()(std::int64_t row) const { return order[row]; }
};

/// The row that a handle refers to; -1 for none.
struct Named {
    const std::uint32_t* handles;
    __device__ std::int64_t operator()(std::int64_t row) const { return std::int64_t(handles[row]) - 1; }
};

template <class Source>
__global__ void gather_columns(std::int64_t n, Source source, int width, int first, int columns, const float* data,
                               float* slice) {
    for_row_values(n, columns, [=](std::int64_t row, unsigned c) {
        const std::int64_t from = source(row);
        slice[row * columns + c] = from < 0 ? 0.0f : data[from * width + first + c];
    });
}

__global__ void put_columns(std::int64_t n, int width, int first, int columns, const float* slice, float* data) {
    for_row_values(n, columns,
                   [=](std::int64_t row, unsigned c) { data[row * width + first + c] = slice[row * columns + c]; });
}

/// Moves row source(k) of `data` to row k for k < n.
template <class Source>
void gather_array(float* data, int width, Source source, std::int64_t n, const RowSlice& slice, cudaStream_t stream) {
    if (n == 0 || width == 0) return;
    int most = int(std::min<std::size_t>(width, slice.floats / n));
    if (most > 8 && most < width) most -= most % 8;  // 8 values are 32 bytes, the unit in which memory is read
    const unsigned blocks = num_blocks(n, kRowsPerBlock);
    for (int first = 0; first < width; first += most) {
        const int columns = std::min(most, width - first);
        gather_columns<<<blocks, kRowBlock, 0, stream>>>(n, source, width, first, columns, data, slice.data);
        GS_CUDA_LAUNCHED("gather_columns");
        put_columns<<<blocks, kRowBlock, 0, stream>>>(n, width, first, columns, slice.data, data);
        GS_CUDA_LAUNCHED("put_columns");
    }
}

__global__ void find_nonfinite(std::int64_t n, const float* values, float largest, unsigned* found) {
    const std::int64_t i = thread_row();
    if (i < n && !in_range(values[i], largest)) *found = 1;
}

/// Marks the broken rows, with one thread per row. It runs only for models known to have such rows.
__global__ void mark_nonfinite_rows(std::int64_t n, int width, const float* values, float largest, unsigned char* bad,
                                    unsigned long long* num_bad) {
    const std::int64_t i = thread_row();
    if (i >= n) return;
    for (int c = 0; c < width; ++c)
        if (!in_range(values[i * width + c], largest)) {
            bad[i] = 1;
            atomicAdd(num_bad, 1ull);
            return;
        }
}

__global__ void mark_invisible_rows(std::int64_t n, ShownOpacities opacities, const float* rotations,
                                    unsigned char* marked) {
    const std::int64_t i = thread_row();
    if (i < n) marked[i] = !is_visible(opacities(i), rotations + 4 * i);
}

}  // namespace

void gather_rows(CudaModel& model, const std::uint32_t* order, std::int64_t kept, std::int64_t total,
                 const RowSlice& slice, cudaStream_t stream) {
    model.rows_moved = true;
    for (int g = 0; g < kNumGroups; ++g) {
        const int width = model.width[g];
        gather_array(model.param[g].get(), width, InOrder{order}, total, slice, stream);
        for (auto* moment : model.moments(g)) {
            gather_array(moment->get(), width, InOrder{order}, kept, slice, stream);
            if (const std::size_t fresh = std::size_t(total - kept) * width)
                GS_CUDA(cudaMemsetAsync(moment->get() + kept * width, 0, fresh * sizeof(float), stream));
        }
    }
    if (model.has_statistic) {
        gather_array(model.gradient_sum.get(), 1, InOrder{order}, kept, slice, stream);
        gather_array(model.gradient_count.get(), 1, InOrder{order}, kept, slice, stream);
    }
    if (model.has_last_step) gather_array(model.last_step.get(), 1, InOrder{order}, total, slice, stream);
    model.count = total;
}

void gather_named(const std::uint32_t* handles, std::int64_t n, int width, const RowSlice& slice, float* data,
                  cudaStream_t stream) {
    gather_array(data, width, Named{handles}, n, slice, stream);
}

void CudaDensify::keep_rows(const std::vector<std::uint32_t>& rows) {
    if (std::int64_t(rows.size()) == model_.count) return;
    std::vector<unsigned char> marked(std::size_t(model_.count), 1);
    for (const std::uint32_t row : rows) marked[row] = 0;
    PruneSpace space(model_, scratch_, stream_);
    GS_CUDA(cudaMemcpyAsync(space.marked, marked.data(), marked.size(), cudaMemcpyHostToDevice, stream_));
    space.remove_marked();
}

std::int64_t CudaDensify::prune_nonfinite(std::int64_t by_group[kNumGroups]) {
    std::fill_n(by_group, kNumGroups, 0);
    const std::int64_t n = model_.count;
    if (n == 0) return 0;
    unsigned* found = nullptr;
    scratch_.carve([&](Carver& c) { found = c.take<unsigned>(1); });
    GS_CUDA(cudaMemsetAsync(found, 0, sizeof *found, stream_));
    for (int g = 0; g < kNumGroups; ++g) {
        if (model_.floats(g) == 0) continue;
        const auto values = std::int64_t(model_.floats(g));
        find_nonfinite<<<num_blocks(values, kRowBlock), kRowBlock, 0, stream_>>>(values, model_.param[g].get(),
                                                                                 kLargestParameter[g], found);
        GS_CUDA_LAUNCHED("find_nonfinite");
    }
    if (!read_back(found, stream_)) return 0;  // the usual case: no row is broken

    PruneSpace space(model_, scratch_, stream_);
    for (int g = 0; g < kNumGroups; ++g) {
        const std::int64_t rows = model_.rows(g);
        if (rows == 0) continue;
        mark_nonfinite_rows<<<num_blocks(rows, kRowBlock), kRowBlock, 0, stream_>>>(
            rows, model_.width[g], model_.param[g].get(), kLargestParameter[g], space.marked, space.num_bad + g);
        GS_CUDA_LAUNCHED("mark_nonfinite_rows");
    }
    unsigned long long num_bad[kNumGroups];
    GS_CUDA(cudaMemcpyAsync(num_bad, space.num_bad, sizeof num_bad, cudaMemcpyDeviceToHost, stream_));
    const std::int64_t removed = space.remove_marked();
    std::copy_n(num_bad, kNumGroups, by_group);
    return removed;
}

std::int64_t CudaDensify::prune_invisible() {
    const std::int64_t n = model_.count;
    if (n == 0) return 0;
    PruneSpace space(model_, scratch_, stream_);
    mark_invisible_rows<<<num_blocks(n, kRowBlock), kRowBlock, 0, stream_>>>(
        n, shown_opacities(model_), model_.param[int(Group::kRotation)].get(), space.marked);
    GS_CUDA_LAUNCHED("mark_invisible_rows");
    return space.remove_marked();
}

}  // namespace gs
