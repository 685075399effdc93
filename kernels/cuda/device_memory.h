// SPDX-License-Identifier: Apache-2.0
// Device memory: growable buffers, one scratch block that is carved anew for every use, and the count of all bytes.
// Only .cu files include this header.
#pragma once

#include <algorithm>
#include <atomic>
#include <utility>
#include <vector>

#include "kernels/cuda/cuda.h"

namespace gs {

/// The bytes held by all buffers of the process now, and their maximum so far.
struct DeviceMemoryCount {
    std::atomic<std::int64_t> now = 0, peak = 0;

    void add(std::int64_t bytes) {
        const std::int64_t sum = now += bytes;
        for (std::int64_t most = peak; most < sum && !peak.compare_exchange_weak(most, sum);) {
        }
    }
};
inline DeviceMemoryCount& device_memory_count() {
    static DeviceMemoryCount count;
    return count;
}

/// Device memory that grows geometrically, and shrinks only on request.
template <class T> class DeviceBuffer {
  public:
    DeviceBuffer() = default;
    DeviceBuffer(const DeviceBuffer&) = delete;
    DeviceBuffer& operator=(const DeviceBuffer&) = delete;
    ~DeviceBuffer() { release(); }

    /// Makes room for at least n elements; growing drops the contents. Throws DeviceError with the requested and free
    /// sizes.
    T* reserve(std::size_t n) {
        if (n > capacity_) {
            const std::size_t wanted = std::max(n, capacity_ + capacity_ / 4);
            release();
            if (wanted == n || !try_allocate(wanted)) allocate(n);
        }
        return data_;
    }
    /// Makes room for n elements and keeps the first `used`. Growing allocates exactly n. Throws DeviceError like
    /// reserve.
    T* grow(std::size_t n, std::size_t used) {
        if (n <= capacity_) return data_;
        DeviceBuffer bigger;
        bigger.allocate(n);
        // Releasing the old memory waits for the device, which orders this copy with the streams that use the memory.
        if (used) GS_CUDA(cudaMemcpy(bigger.data_, data_, used * sizeof(T), cudaMemcpyDeviceToDevice));
        swap(bigger);
        return data_;
    }
    /// Makes room for exactly n elements and keeps the first `used`. If memory does not suffice for a second copy, or
    /// that copy would exceed the process's peak, the elements are moved through the host. Throws DeviceError like
    /// reserve; the elements are then lost.
    void refit(std::size_t n, std::size_t used) {
        GS_CUDA(cudaDeviceSynchronize());
        DeviceBuffer other;
        const DeviceMemoryCount& count = device_memory_count();
        if (count.now + std::int64_t(n * sizeof(T)) <= count.peak && other.try_allocate(n)) {
            if (used > 0) GS_CUDA(cudaMemcpy(other.data_, data_, used * sizeof(T), cudaMemcpyDeviceToDevice));
            return swap(other);
        }
        const std::vector<T> kept = download(used);
        release();
        allocate(n);
        if (used > 0) GS_CUDA(cudaMemcpy(data_, kept.data(), used * sizeof(T), cudaMemcpyHostToDevice));
    }
    /// Frees the memory beyond n elements, if there is any, and keeps the first n.
    void shrink(std::size_t n) {
        if (n == 0)
            release();
        else if (n < capacity_)
            refit(n, n);
    }
    void swap(DeviceBuffer& other) {
        std::swap(data_, other.data_);
        std::swap(capacity_, other.capacity_);
    }
    T* get() const { return data_; }
    std::int64_t bytes() const { return std::int64_t(capacity_ * sizeof(T)); }
    std::size_t capacity() const { return capacity_; }

    /// Copies all of `host` to the device and waits.
    void upload(const std::vector<T>& host) {
        if (!host.empty())
            GS_CUDA(cudaMemcpy(reserve(host.size()), host.data(), host.size() * sizeof(T), cudaMemcpyHostToDevice));
    }
    /// Uploads `n` moments, or zeros if the host has dropped them.
    void upload_or_zero(const std::vector<T>& host, std::size_t n) {
        upload(host);
        if (host.empty() && n > 0) GS_CUDA(cudaMemset(reserve(n), 0, n * sizeof(T)));
    }
    std::vector<T> download(std::size_t n) const {
        std::vector<T> host(n);
        if (n) GS_CUDA(cudaMemcpy(host.data(), data_, n * sizeof(T), cudaMemcpyDeviceToHost));
        return host;
    }

  private:
    void release() {
        cudaFree(data_);
        device_memory_count().add(-std::int64_t(bytes()));
        data_ = nullptr, capacity_ = 0;
    }
    bool try_allocate(std::size_t n) {
        if (cudaMalloc(&data_, n * sizeof(T)) != cudaSuccess) {
            cudaGetLastError();
            data_ = nullptr;
            return false;
        }
        capacity_ = n;
        device_memory_count().add(std::int64_t(bytes()));
        return true;
    }
    void allocate(std::size_t n) {
        if (!try_allocate(n)) {
            std::size_t free = 0, total = 0;
            cudaMemGetInfo(&free, &total);
            throw DeviceError("out of device memory: asked for " + std::to_string(n * sizeof(T) >> 20) + " MiB, free " +
                              std::to_string(free >> 20) + " of " + std::to_string(total >> 20) +
                              " MiB; lower --cap-max, --resolution or --image-cache");
        }
    }

    T* data_ = nullptr;
    std::size_t capacity_ = 0;
};

/// Hands out consecutive pieces of a block. With a null block it only measures the size.
class Carver {
  public:
    explicit Carver(unsigned char* block) : block_(block) {}
    /// Returns n elements of T on a 256-byte boundary.
    template <class T> T* take(std::size_t n) {
        T* piece = block_ ? reinterpret_cast<T*>(block_ + at_) : nullptr;
        at_ += (n * sizeof(T) + 255) / 256 * 256;
        most_ = std::max(most_, at_);
        return piece;
    }
    std::size_t at() const { return at_; }
    /// Returns to an earlier at(). Pieces taken since then become invalid, and their memory is handed out again.
    void rewind(std::size_t at) { at_ = at; }
    std::size_t most() const { return most_; }

  private:
    unsigned char* block_;
    std::size_t at_ = 0, most_ = 0;
};

/// A block for memory that lives no longer than an iteration or a densification.
class Scratch {
  public:
    /// Runs layout(Carver&) twice, first to measure and then to take; it must make the same requests both times. Pieces
    /// taken before become invalid. If the block grows, it grows to at least `room` bytes.
    template <class Layout> void carve(Layout&& layout, std::size_t room = 0) {
        Carver count(nullptr);
        layout(count);
        std::size_t bytes = count.most();
        if (bytes > std::size_t(block_.bytes())) {
            release();
            bytes = std::max(bytes, room);
        }
        Carver c(block_.reserve(bytes));
        layout(c);
    }
    /// Frees the memory. Pieces taken before become invalid.
    void release() { block_.shrink(0); }
    std::int64_t bytes() const { return block_.bytes(); }

  private:
    DeviceBuffer<unsigned char> block_;
};

}  // namespace gs
