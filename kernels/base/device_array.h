// SPDX-License-Identifier: Apache-2.0
// Arrays in the memory in which their rank computes, host or device. Code that moves arrays uses them without CUDA.
#pragma once

#include <cstddef>
#include <cstring>
#include <memory>
#include <span>
#include <type_traits>
#include <vector>

namespace gs {

/// Growable device memory.
class DeviceBlock {
  public:
    virtual ~DeviceBlock() = default;
    /// Makes room for `bytes` bytes and returns the address; growing drops the contents. Throws DeviceError if memory
    /// runs out.
    virtual std::byte* reserve(std::size_t bytes) = 0;
};

/// The device of a rank. It executes work in order on one stream; a second stream is for transfers between ranks.
class DeviceStream {
  public:
    /// Makes an empty block, which may outlive this object.
    virtual std::unique_ptr<DeviceBlock> make_block() = 0;
    /// Copies between host and device memory in any direction. Host memory must stay unchanged until the device is
    /// idle.
    virtual void copy(void* to, const void* from, std::size_t bytes) = 0;
    /// Waits until all work is done. Throws DeviceError if an error occurred.
    virtual void wait() = 0;
    /// Marks the work queued so far: the next transfers wait for it, and for no later work.
    virtual void mark() = 0;
    /// Returns the stream for transfers, a cudaStream_t, which waits for the marked work.
    virtual void* begin_transfer() = 0;
    /// Makes work queued from now on wait for all transfers that have begun.
    virtual void join_transfers() = 0;

  protected:
    ~DeviceStream() = default;
};

/// A device block that can temporarily be placed in other device memory.
class PlacedBlock final : public DeviceBlock {
  public:
    explicit PlacedBlock(std::unique_ptr<DeviceBlock> own) : own_(std::move(own)) {}
    /// Places the block at `place`, which must have room for all reserved bytes; null: in its own memory.
    void lie_at(std::byte* place) { place_ = place; }
    std::byte* reserve(std::size_t bytes) override { return place_ ? place_ : own_->reserve(bytes); }

  private:
    const std::unique_ptr<DeviceBlock> own_;
    std::byte* place_ = nullptr;
};

template <class T> class DeviceArray {
    static_assert(std::is_trivially_copyable_v<T>);

  public:
    /// Makes an empty array in the memory of `device`, which must outlive it, or in host memory if it is null.
    explicit DeviceArray(DeviceStream* device = nullptr)
        : device_(device), block_(device ? std::make_shared<PlacedBlock>(device->make_block()) : nullptr) {}

    DeviceArray(DeviceArray&&) = default;
    DeviceArray& operator=(DeviceArray&&) = default;

    /// Makes an empty array in the memory of `other`, which loses its values as soon as the new array gets any. On the
    /// host each array has its own memory.
    template <class U> static DeviceArray in_memory_of(const DeviceArray<U>& other) {
        static_assert(sizeof(T) <= sizeof(U), "as many values must fit");
        DeviceArray array;
        array.device_ = other.device_, array.block_ = other.block_;
        return array;
    }

    /// Places the array, and arrays in the same memory, at `place` on the device from their next resize() on. There
    /// must be room for them; null: their own memory. Has no effect on the host.
    void lie_at(std::byte* place) {
        if (block_) block_->lie_at(place);
    }
    /// Changes the number of values. Growing loses the values, and arrays in the same memory must then be resized
    /// before use. Throws DeviceError if memory runs out.
    T* resize(std::size_t size) {
        if (device_) {
            data_ = reinterpret_cast<T*>(block_->reserve(size * sizeof(T)));
        } else {
            values_.resize(size);
            data_ = values_.data();
        }
        size_ = size;
        return data_;
    }
    /// Copies values from the host.
    void assign(const std::vector<T>& values) {
        resize(values.size());
        if (values.empty()) return;
        if (!device_) {
            std::memcpy(data_, values.data(), size_ * sizeof(T));
            return;
        }
        device_->copy(data_, values.data(), size_ * sizeof(T));
        device_->wait();
    }

    DeviceStream* device() const { return device_; }
    std::size_t size() const { return size_; }
    T* data() { return data_; }
    const T* data() const { return data_; }
    /// Returns the values of an array in host memory.
    std::span<T> values() { return {data_, size_}; }
    std::span<const T> values() const { return {data_, size_}; }
    /// Returns the values in host memory. For a device array they are copied to `copy`.
    std::span<const T> on_host(std::vector<T>& copy) const {
        if (!device_ || size_ == 0) return values();
        copy.resize(size_);
        device_->copy(copy.data(), data_, size_ * sizeof(T));
        device_->wait();
        return copy;
    }

    /// Returns the bytes of the values in [begin, end), in host or device memory.
    std::span<std::byte> bytes(std::size_t begin, std::size_t end) {
        return std::as_writable_bytes(values().subspan(begin, end - begin));
    }
    std::span<std::byte> bytes() { return std::as_writable_bytes(values()); }
    std::span<const std::byte> bytes() const { return std::as_bytes(values()); }

  private:
    template <class U> friend class DeviceArray;

    DeviceStream* device_;
    std::shared_ptr<PlacedBlock> block_;  ///< the device block, if there is a device
    std::vector<T> values_;               ///< the values in host memory otherwise
    T* data_ = nullptr;
    std::size_t size_ = 0;
};

}  // namespace gs
