// SPDX-License-Identifier: Apache-2.0
// The device of a rank, as those see it who move its arrays and know no CUDA.
#pragma once

#include <cstddef>
#include <memory>

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

}  // namespace gs
