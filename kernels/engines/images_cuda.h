// SPDX-License-Identifier: Apache-2.0
// The training images on the device. They are kept within a memory budget; others are uploaded ahead of use through
// pinned memory.
#pragma once

#include <memory>
#include <unordered_map>

#include "kernels/cuda/device_memory.h"
#include "kernels/requests.h"

namespace gs {

/// A target with pointers into device memory.
struct DeviceTarget {
    TargetImage image;
    double weight_sum = 0;  ///< sum of the mask's weights, or the number of pixels without a mask
};

/// Host memory that the device copies from without a staging buffer.
class PinnedBuffer {
  public:
    PinnedBuffer() = default;
    PinnedBuffer(const PinnedBuffer&) = delete;
    PinnedBuffer& operator=(const PinnedBuffer&) = delete;
    ~PinnedBuffer() { cudaFreeHost(data_); }
    unsigned char* reserve(std::size_t bytes);
    const unsigned char* get() const { return data_; }

  private:
    unsigned char* data_ = nullptr;
    std::size_t bytes_ = 0;
};

/// Uploads training images and keeps them within a budget.
class CudaImages {
  public:
    /// Keeps up to `budget` bytes of images. `slots` is the number of steps that may be in flight.
    CudaImages(std::int64_t budget, int slots);
    ~CudaImages();

    /// Starts the upload unless the image is on the device, and makes `stream` wait for it. All reads of the last image
    /// of `slot` must be complete. The result stays valid until `slot` is used again.
    DeviceTarget get(const TargetImage& target, int slot, cudaStream_t stream);

    /// Memory borrowed from the kept images: about `bytes`, or less if the images take less. It is free while the
    /// object lives. No step may be in flight.
    class BorrowedMemory {
      public:
        BorrowedMemory(CudaImages& images, std::int64_t bytes);
        ~BorrowedMemory() { images_.budget_now_ = images_.budget_; }
        BorrowedMemory(const BorrowedMemory&) = delete;
        BorrowedMemory& operator=(const BorrowedMemory&) = delete;

      private:
        CudaImages& images_;
    };

    std::int64_t kept_bytes() const { return kept_bytes_; }
    std::size_t num_kept() const { return kept_.size(); }
    std::int64_t slot_bytes() const;

  private:
    struct Slot {
        PinnedBuffer pinned;
        DeviceBuffer<unsigned char> device;
        cudaEvent_t uploaded = nullptr;
    };
    struct Kept {
        DeviceBuffer<unsigned char> memory;
        DeviceTarget target;
    };

    std::int64_t budget_;
    std::int64_t budget_now_ = budget_;
    std::int64_t kept_bytes_ = 0;
    std::vector<std::unique_ptr<Slot>> slots_;
    std::unordered_map<ImageId, std::unique_ptr<Kept>, ImageIdHash> kept_;
    cudaStream_t stream_ = nullptr;
};

}  // namespace gs
