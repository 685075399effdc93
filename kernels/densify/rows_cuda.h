// SPDX-License-Identifier: Apache-2.0
// Moves rows and the handles of their residuals on the device. The .cu files of this folder share these functions.
#pragma once

#include <thrust/iterator/counting_iterator.h>

#include <cub/device/device_select.cuh>

#include "kernels/cuda/model_cuda.h"
#include "kernels/densify/rows_device.h"

namespace gs {

/// The device version of ResidualHandles. While it lives, `model` looks like one whose Gaussians all have a residual of
/// one value.
class CudaResidualHandles {
  public:
    /// With `always`, also handles a model whose Gaussians all have a residual.
    CudaResidualHandles(CudaModel& model, cudaStream_t stream, bool always = false);
    /// Restores the original residuals, unless they were resolved. If rows have moved by then, which only happens after
    /// an error, the model is broken.
    ~CudaResidualHandles();
    CudaResidualHandles(const CudaResidualHandles&) = delete;
    CudaResidualHandles& operator=(const CudaResidualHandles&) = delete;

    /// Removes the residual of Gaussians without a mark, as Backend::keep_residuals does. `marks` (n) and `bases`
    /// (n,3), or null, are on the device, but not in the scratch.
    void keep(const unsigned char* marks, const float* bases);
    /// Converts the handles back to rows, and waits. It may use all of `scratch`.
    void resolve(Scratch& scratch);

  private:
    /// Exchanges the residuals and their moments with model_.handles.
    void swap_arrays();

    CudaModel& model_;
    cudaStream_t stream_;
    bool active_;
    int width_ = 0;
    std::int64_t num_residuals_ = 0, without_residual_ = 0;
};

inline constexpr int kRowBlock = 256;
/// Number of rows moved by one block. It is small, so that a few thousand relocated rows still occupy the device.
inline constexpr int kRowsPerBlock = 64;
/// Size of a gather's temporary in bytes. A larger one is not faster.
inline constexpr std::size_t kSliceBytes = std::size_t(64) << 20;

/// Calls fn(row, column) for all values of n rows of a few columns; neighbouring threads get neighbouring values. The
/// kernel must have num_blocks(n, kRowsPerBlock) blocks of kRowBlock threads.
template <class Fn> __device__ void for_row_values(std::int64_t n, unsigned columns, Fn fn) {
    const std::int64_t first = std::int64_t(blockIdx.x) * kRowsPerBlock, left = n - first;
    const unsigned values = unsigned(left < kRowsPerBlock ? left : kRowsPerBlock) * columns;
    for (unsigned j = threadIdx.x; j < values; j += kRowBlock) fn(first + j / columns, j % columns);
}

/// Returns the index of the thread in a one-dimensional grid with kRowBlock threads a block.
__device__ inline std::int64_t thread_row() { return std::int64_t(blockIdx.x) * kRowBlock + threadIdx.x; }

/// Temporary memory shared by the CUB calls of one function. A call is a lambda (void*, size_t&). It may capture by
/// reference pointers that are carved only after `ask`.
struct CubSpace {
    unsigned char* memory = nullptr;
    std::size_t bytes = 1;

    template <class Call> void ask(Call&& call) {
        std::size_t b = 0;
        GS_CUDA(call(static_cast<void*>(nullptr), b));
        bytes = std::max(bytes, b);
    }
    void take(Carver& c) { memory = c.take<unsigned char>(bytes); }
    template <class Call> void run(Call&& call) const {
        std::size_t b = bytes;
        GS_CUDA(call(static_cast<void*>(memory), b));
    }
};

inline ShownOpacities shown_opacities(const CudaModel& model) {
    return {model.param[int(Group::kOpacity)].get(), model.param[int(Group::kScale)].get(), model.smoothing()};
}

/// Returns the row indices 0, 1, ... as an input of CUB.
inline thrust::counting_iterator<std::uint32_t> row_indices() { return thrust::counting_iterator<std::uint32_t>(0); }

/// Writes the rows i < n for which keep(i) holds to `out`, ascending, and their number to `num_out`.
template <class Keep>
cudaError_t select_rows(void* memory, std::size_t& bytes, std::int64_t n, const Keep& keep, std::uint32_t* out,
                        std::int64_t* num_out, cudaStream_t stream) {
    return cub::DeviceSelect::If(memory, bytes, row_indices(), out, num_out, n, keep, stream);
}

/// Reads one value from the device and waits for it.
template <class T> T read_back(const T* device, cudaStream_t stream) {
    T value;
    GS_CUDA(cudaMemcpyAsync(&value, device, sizeof value, cudaMemcpyDeviceToHost, stream));
    GS_CUDA(cudaStreamSynchronize(stream));
    return value;
}

/// The temporary of a gather, which holds a few columns of all its rows.
struct RowSlice {
    float* data = nullptr;
    std::size_t floats = 0;
};

/// Takes a slice for up to `rows` rows. `block` is the scratch's size in bytes before carving; the slice uses
/// the remaining bytes.
inline RowSlice take_slice(Carver& c, const CudaModel& model, std::int64_t rows, std::int64_t block) {
    const std::size_t left = std::size_t(block) > c.at() + 256 ? std::size_t(block) - c.at() - 256 : 0;
    const auto widest = std::size_t(*std::max_element(model.width, model.width + kNumGroups));
    RowSlice slice;
    slice.floats = std::clamp(std::max(left, kSliceBytes) / sizeof(float), std::size_t(rows),
                              std::size_t(rows) * std::max<std::size_t>(widest, 1));
    slice.data = c.take<float>(slice.floats);
    return slice;
}

/// Makes old row order[k] the new row k for k < total, removes rows that are not in `order`, and sets the count.
/// Moments move along up to row `kept`; later rows are copies and start with moments of 0. `order` is on the device.
/// There must be room for `total` rows.
void gather_rows(CudaModel& model, const std::uint32_t* order, std::int64_t kept, std::int64_t total,
                 const RowSlice& slice, cudaStream_t stream);

/// Moves the row of `data` that handle k refers to to row k, for k < n; a null handle gives zeros (residual_handles.h).
/// The handles are on the device.
void gather_named(const std::uint32_t* handles, std::int64_t n, int width, const RowSlice& slice, float* data,
                  cudaStream_t stream);

struct IsUnmarked {
    const unsigned char* marked;
    __device__ bool operator()(std::uint32_t i) const { return !marked[i]; }
};

/// A mark for each row, and the buffers for removing the marked rows.
struct PruneSpace {
    unsigned char* marked = nullptr;        ///< (n) 0 at first
    unsigned long long* num_bad = nullptr;  ///< (groups) counters, 0 at first

    PruneSpace(CudaModel& model, Scratch& scratch, cudaStream_t stream)
        : model_(model), scratch_(scratch), stream_(stream) {
        const std::int64_t n = model.count, block = scratch.bytes();
        cub_.ask([&](void* m, std::size_t& b) { return select(m, b); });
        scratch.carve([&](Carver& c) {
            marked = c.take<unsigned char>(n), num_bad = c.take<unsigned long long>(kNumGroups);
            order_ = c.take<std::uint32_t>(n), num_kept_ = c.take<std::int64_t>(1);
            cub_.take(c);
            slice_ = take_slice(c, model, n, block);
        });
        GS_CUDA(cudaMemsetAsync(marked, 0, n, stream));
        GS_CUDA(cudaMemsetAsync(num_bad, 0, kNumGroups * sizeof *num_bad, stream));
    }
    /// Removes the marked rows, waits, and returns their number.
    std::int64_t remove_marked() {
        const std::int64_t n = model_.count;
        cub_.run([&](void* m, std::size_t& b) { return select(m, b); });
        const std::int64_t kept = read_back(num_kept_, stream_);
        if (kept == n) return 0;
        CudaResidualHandles residuals(model_, stream_);
        gather_rows(model_, order_, kept, kept, slice_, stream_);
        GS_CUDA(cudaStreamSynchronize(stream_));
        residuals.resolve(scratch_);
        return n - kept;
    }

  private:
    cudaError_t select(void* m, std::size_t& b) const {
        return select_rows(m, b, model_.count, IsUnmarked{marked}, order_, num_kept_, stream_);
    }

    CudaModel& model_;
    Scratch& scratch_;
    cudaStream_t stream_;
    std::uint32_t* order_ = nullptr;
    std::int64_t* num_kept_ = nullptr;
    CubSpace cub_;
    RowSlice slice_;
};

}  // namespace gs
