// SPDX-License-Identifier: Apache-2.0
// Replaces residuals by handles, and handles by residuals, on the device.
#include "kernels/densify/rows_cuda.h"

namespace gs {
namespace {

constexpr int kResidual = int(Group::kResidual);

__global__ void write_handles(std::int64_t n, std::int64_t num_residuals, std::uint32_t* handles) {
    const std::int64_t i = thread_row();
    if (i < n) handles[i] = i < num_residuals ? std::uint32_t(i + 1) : 0u;
}

__global__ void drop_handles(std::int64_t n, const unsigned char* marks, const float* bases, std::uint32_t* handles,
                             float* base_colors) {
    const std::int64_t i = thread_row();
    if (i >= n || marks[i] || handles[i] == 0) return;
    handles[i] = 0;
    for (int c = 0; c < 3 && bases; ++c) base_colors[3 * i + c] = bases[3 * i + c];
}

struct HasHandle {
    const std::uint32_t* handles;
    bool wanted;
    __host__ __device__ bool operator()(std::uint32_t i) const { return (handles[i] != 0) == wanted; }
};

std::uint32_t* handles_in(const DeviceBuffer<float>& buffer) { return reinterpret_cast<std::uint32_t*>(buffer.get()); }

}  // namespace

CudaResidualHandles::CudaResidualHandles(CudaModel& model, cudaStream_t stream, bool always)
    : model_(model),
      stream_(stream),
      active_(model.width[kResidual] > 0 && (always || model.without_residual > 0)),
      width_(model.width[kResidual]),
      num_residuals_(model.num_residuals()),
      without_residual_(model.without_residual) {
    if (!active_) return;
    const std::int64_t n = model_.count;
    for (std::size_t k = 0; k <= model_.moments(kResidual).size() && n > 0; ++k) {
        model_.handles[k].reserve(n);
        write_handles<<<num_blocks(n, kRowBlock), kRowBlock, 0, stream_>>>(n, num_residuals_,
                                                                           handles_in(model_.handles[k]));
        GS_CUDA_LAUNCHED("write_handles");
    }
    swap_arrays();
    model_.width[kResidual] = 1, model_.without_residual = 0;
    model_.rows_moved = false;
}

CudaResidualHandles::~CudaResidualHandles() {
    if (!active_) return;
    swap_arrays();
    model_.width[kResidual] = width_, model_.without_residual = without_residual_;
    if (model_.rows_moved) model_.broken = true;  // the residuals no longer match their rows
}

void CudaResidualHandles::swap_arrays() {
    model_.param[kResidual].swap(model_.handles[0]);
    int k = 0;
    for (auto* moment : model_.moments(kResidual)) moment->swap(model_.handles[++k]);
}

void CudaResidualHandles::keep(const unsigned char* marks, const float* bases) {
    const std::int64_t n = model_.count;
    if (!active_ || n == 0) return;
    drop_handles<<<num_blocks(n, kRowBlock), kRowBlock, 0, stream_>>>(
        n, marks, bases, handles_in(model_.param[kResidual]), model_.param[int(Group::kBase)].get());
    GS_CUDA_LAUNCHED("drop_handles");
}

void CudaResidualHandles::resolve(Scratch& scratch) {
    if (!active_) return;
    const std::int64_t n = model_.count, block = scratch.bytes();
    std::int64_t kept = 0;
    if (n > 0) {
        std::uint32_t *order = nullptr, *selected = nullptr;
        std::int64_t* num_selected = nullptr;
        HasHandle has_handle{handles_in(model_.param[kResidual]), true};
        CubSpace cub;
        RowSlice slice;
        const auto select = [&](void* m, std::size_t& b) {
            return select_rows(m, b, n, has_handle, selected, num_selected, stream_);
        };
        cub.ask(select);
        scratch.carve([&](Carver& c) {
            order = c.take<std::uint32_t>(n), num_selected = c.take<std::int64_t>(1);
            cub.take(c);
            slice = take_slice(c, model_, n, block);
        });
        selected = order;
        cub.run(select);
        kept = read_back(num_selected, stream_);
        has_handle.wanted = false, selected = order + kept;
        cub.run(select);
        gather_rows(model_, order, n, n, slice, stream_);
        // Allocates some more, so that the next changes need no new memory.
        const std::size_t room = std::size_t(std::min(n, kept + kept / 8)) * width_,
                          used = std::size_t(num_residuals_) * width_;
        GS_CUDA(cudaStreamSynchronize(stream_));
        std::size_t k = 0;
        const auto resolve_array = [&](const DeviceBuffer<float>& handles) {
            DeviceBuffer<float>& rows = model_.handles[k++];
            if (rows.capacity() < std::size_t(kept) * width_) rows.refit(room, used);
            gather_named(handles_in(handles), kept, width_, slice, rows.get(), stream_);
            if (rows.capacity() > room + room / 8) rows.shrink(room);
        };
        resolve_array(model_.param[kResidual]);
        for (auto* moment : model_.moments(kResidual)) resolve_array(*moment);
        GS_CUDA(cudaStreamSynchronize(stream_));
    }
    without_residual_ = n - kept;
    swap_arrays();
    model_.width[kResidual] = width_, model_.without_residual = without_residual_;
    active_ = false;
}

}  // namespace gs
