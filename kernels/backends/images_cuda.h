// SPDX-License-Identifier: Apache-2.0
// Training images on the device: kept within a budget, else uploaded ahead of use through pinned memory.
#pragma once

#include <memory>
#include <unordered_map>

#include "kernels/cuda/device_memory.h"
#include "kernels/requests.h"

namespace gs {

/// A target with pointers into device memory.
struct DeviceTarget {
    TargetImage image;
    double weight_sum = 0; ///< of the mask, or the number of pixels
};

/// Host memory that the device copies from without staging.
class PinnedBuffer {
  public:
    PinnedBuffer() = default;
    PinnedBuffer(const PinnedBuffer&) = delete;
    PinnedBuffer& operator=(const PinnedBuffer&) = delete;
    ~PinnedBuffer() { cudaFreeHost(data_); }
    unsigned char* reserve(std::size_t bytes);

  private:
    unsigned char* data_ = nullptr;
    std::size_t bytes_ = 0;
};

class CudaImages {
  public:
    /// `slots`: how many steps may be in flight.
    CudaImages(std::int64_t budget, int slots);
    ~CudaImages();

    /// Starts the upload unless the image is there, and lets `stream` wait for it. The result stays valid until `slot`, whose
    /// last step must be done, is used again.
    DeviceTarget get(const TargetImage& target, int slot, cudaStream_t stream);

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
    std::int64_t kept_bytes_ = 0;
    std::vector<std::unique_ptr<Slot>> slots_;
    std::unordered_map<std::int64_t, std::unique_ptr<Kept>> kept_;
    cudaStream_t stream_ = nullptr;
};

}  // namespace gs
