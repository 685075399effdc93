// SPDX-License-Identifier: Apache-2.0
// What ranks exchange lies where the rank computes: in the host's memory, or in that of its device, which those who
// move arrays see without CUDA.
#pragma once

#include <cstddef>
#include <cstring>
#include <memory>
#include <span>
#include <type_traits>
#include <vector>

namespace gs {

/// Memory of a device that grows.
class DeviceBlock {
  public:
    virtual ~DeviceBlock() = default;
    /// Makes room for so many bytes and returns where; growing drops the contents. Throws DeviceError if there is none.
    virtual std::byte* reserve(std::size_t bytes) = 0;
};

/// The device of a rank. What it is told it does in order, on one stream; a second one is for what passes between
/// ranks.
class DeviceStream {
  public:
    /// Makes an empty block, which may outlive this object.
    virtual std::unique_ptr<DeviceBlock> make_block() = 0;
    /// Copies between the host's and the device's memory in any direction. Memory of the host must stay as it is until
    /// the device is idle.
    virtual void copy(void* to, const void* from, std::size_t bytes) = 0;
    /// Waits until everything is done. Throws DeviceError if something went wrong.
    virtual void wait() = 0;
    /// Marks what the device was told so far: the next transfers wait for this, and for nothing that it is told later.
    virtual void mark() = 0;
    /// Returns the stream for transfers, a cudaStream_t, which waits for what was marked.
    virtual void* begin_transfer() = 0;
    /// Lets what the device is told from now on wait for all transfers that have begun.
    virtual void join_transfers() = 0;

  protected:
    ~DeviceStream() = default;
};

/// Memory of a device that lies in other memory of it for a while.
class PlacedBlock final : public DeviceBlock {
  public:
    explicit PlacedBlock(std::unique_ptr<DeviceBlock> own) : own_(std::move(own)) {}
    /// Lets the block lie at `place`, where there must be room for what is reserved; null: in memory of its own.
    void lie_at(std::byte* place) { place_ = place; }
    std::byte* reserve(std::size_t bytes) override { return place_ ? place_ : own_->reserve(bytes); }

  private:
    const std::unique_ptr<DeviceBlock> own_;
    std::byte* place_ = nullptr;
};

template <class T> class DeviceArray {
    static_assert(std::is_trivially_copyable_v<T>);

  public:
    /// Makes an empty array in the memory of `device`, which must outlive it, or in the host's if that is null.
    explicit DeviceArray(DeviceStream* device = nullptr)
        : device_(device), block_(device ? std::make_shared<PlacedBlock>(device->make_block()) : nullptr) {}

    DeviceArray(DeviceArray&&) = default;
    DeviceArray& operator=(DeviceArray&&) = default;

    /// Makes an empty array in the memory of `other`, which loses its values as soon as this one gets any. On the host
    /// each has memory of its own.
    template <class U> static DeviceArray in_memory_of(const DeviceArray<U>& other) {
        static_assert(sizeof(T) <= sizeof(U), "as many values must fit");
        DeviceArray array;
        array.device_ = other.device_, array.block_ = other.block_;
        return array;
    }

    /// Lets the array and those in its memory lie at `place` of the device from their next resize() on, where there
    /// must be room for them; null: in memory of its own. On the host nothing changes.
    void lie_at(std::byte* place) {
        if (block_) block_->lie_at(place);
    }
    /// Changes the number of values. They are lost where it grows, and arrays in the same memory must then be resized
    /// before they are used. Throws DeviceError if there is no memory.
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
    /// Takes over values of the host.
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
    /// Returns the values of an array in the host's memory.
    std::span<T> values() { return {data_, size_}; }
    std::span<const T> values() const { return {data_, size_}; }
    /// Returns the values where the host can read them: `copy` holds those of a device.
    std::span<const T> on_host(std::vector<T>& copy) const {
        if (!device_ || size_ == 0) return values();
        copy.resize(size_);
        device_->copy(copy.data(), data_, size_ * sizeof(T));
        device_->wait();
        return copy;
    }

    /// Returns the bytes of the values from `begin` to before `end`, wherever they lie.
    std::span<std::byte> bytes(std::size_t begin, std::size_t end) {
        return std::as_writable_bytes(values().subspan(begin, end - begin));
    }
    std::span<std::byte> bytes() { return std::as_writable_bytes(values()); }
    std::span<const std::byte> bytes() const { return std::as_bytes(values()); }

  private:
    template <class U> friend class DeviceArray;

    DeviceStream* device_;
    std::shared_ptr<PlacedBlock> block_;  ///< of the device, if there is one
    std::vector<T> values_;               ///< in the host's memory otherwise
    T* data_ = nullptr;
    std::size_t size_ = 0;
};

}  // namespace gs
