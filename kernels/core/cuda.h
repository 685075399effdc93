// SPDX-License-Identifier: Apache-2.0
// Checked CUDA calls and device memory. Included by .cu files only.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "kernels/core/error.h"

namespace gs {

inline void cuda_check(cudaError_t error, const char* what) {
    if (error == cudaSuccess) return;
    cudaGetLastError(); // clear it: the process may go on, e.g. to write a checkpoint
    throw DeviceError(std::string(what) + ": " + cudaGetErrorString(error));
}
#define GS_CUDA(call) ::gs::cuda_check((call), #call)
/// After every launch, in every build.
#define GS_CUDA_LAUNCHED(name) ::gs::cuda_check(cudaGetLastError(), name)

inline unsigned num_blocks(std::int64_t n, int block) { return static_cast<unsigned>((n + block - 1) / block); }

/// Device memory that grows geometrically and never shrinks; growing drops the contents.
template <class T> class DeviceBuffer {
  public:
    DeviceBuffer() = default;
    DeviceBuffer(const DeviceBuffer&) = delete;
    DeviceBuffer& operator=(const DeviceBuffer&) = delete;
    ~DeviceBuffer() { cudaFree(data_); }

    /// At least n elements. Throws DeviceError naming what was asked and what was free.
    T* reserve(std::size_t n) {
        if (n <= capacity_) return data_;
        const std::size_t wanted = n > capacity_ + capacity_ / 4 ? n : capacity_ + capacity_ / 4;
        cudaFree(data_);
        data_ = nullptr, capacity_ = 0;
        if (cudaMalloc(&data_, wanted * sizeof(T)) != cudaSuccess) {
            cudaGetLastError();
            std::size_t free = 0, total = 0;
            cudaMemGetInfo(&free, &total);
            throw DeviceError("out of device memory: asked for " + std::to_string(wanted * sizeof(T) >> 20) + " MiB, free " + std::to_string(free >> 20) +
                              " of " + std::to_string(total >> 20) + " MiB; lower --cap-max, --resolution or --image-cache");
        }
        capacity_ = wanted;
        return data_;
    }
    /// As reserve, keeping the first `used` elements.
    T* grow(std::size_t n, std::size_t used) {
        if (n <= capacity_) return data_;
        DeviceBuffer bigger;
        bigger.reserve(n);
        if (used) GS_CUDA(cudaMemcpy(bigger.data_, data_, used * sizeof(T), cudaMemcpyDeviceToDevice));
        std::swap(data_, bigger.data_);
        std::swap(capacity_, bigger.capacity_);
        return data_;
    }
    T* get() const { return data_; }
    std::size_t bytes() const { return capacity_ * sizeof(T); }

    void upload(const std::vector<T>& host, cudaStream_t stream = nullptr) {
        if (!host.empty()) GS_CUDA(cudaMemcpyAsync(reserve(host.size()), host.data(), host.size() * sizeof(T), cudaMemcpyHostToDevice, stream));
    }
    std::vector<T> download(std::size_t n) const {
        std::vector<T> host(n);
        if (n) GS_CUDA(cudaMemcpy(host.data(), data_, n * sizeof(T), cudaMemcpyDeviceToHost));
        return host;
    }

  private:
    T* data_ = nullptr;
    std::size_t capacity_ = 0;
};

}  // namespace gs
