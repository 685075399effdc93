// SPDX-License-Identifier: Apache-2.0
// A CUDA device as a rank shows it to those who move its arrays. Only .cu files include this header.
#pragma once

#include "kernels/base/device_stream.h"
#include "kernels/cuda/device_memory.h"

namespace gs {

class CudaDeviceStream final : public DeviceStream {
  public:
    /// Works on a stream, which must outlive it, of the device that is current.
    explicit CudaDeviceStream(cudaStream_t stream) : stream_(stream) {}
    ~CudaDeviceStream() {
        if (!transfers_) return;
        cudaStreamSynchronize(transfers_);
        cudaEventDestroy(marked_);
        cudaEventDestroy(transferred_);
        cudaStreamDestroy(transfers_);
    }
    CudaDeviceStream(const CudaDeviceStream&) = delete;
    CudaDeviceStream& operator=(const CudaDeviceStream&) = delete;

    std::unique_ptr<DeviceBlock> make_block() override { return std::make_unique<Block>(); }
    void copy(void* to, const void* from, std::size_t bytes) override {
        GS_CUDA(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDefault, stream_));
    }
    void wait() override { GS_CUDA(cudaStreamSynchronize(stream_)); }
    void mark() override {
        if (!transfers_) {
            int least = 0, greatest = 0;
            GS_CUDA(cudaDeviceGetStreamPriorityRange(&least, &greatest));
            // Other ranks wait for the splats, and nobody yet for what is computed meanwhile.
            GS_CUDA(cudaStreamCreateWithPriority(&transfers_, cudaStreamNonBlocking, greatest));
            GS_CUDA(cudaEventCreateWithFlags(&marked_, cudaEventDisableTiming));
            GS_CUDA(cudaEventCreateWithFlags(&transferred_, cudaEventDisableTiming));
        }
        GS_CUDA(cudaEventRecord(marked_, stream_));
    }
    void* begin_transfer() override {
        GS_CUDA(cudaStreamWaitEvent(transfers_, marked_));
        return transfers_;
    }
    void join_transfers() override {
        if (!transfers_) return;
        GS_CUDA(cudaEventRecord(transferred_, transfers_));
        GS_CUDA(cudaStreamWaitEvent(stream_, transferred_));
    }

  private:
    class Block final : public DeviceBlock {
      public:
        std::byte* reserve(std::size_t bytes) override { return buffer_.reserve(bytes); }

      private:
        DeviceBuffer<std::byte> buffer_;
    };

    const cudaStream_t stream_;
    cudaStream_t transfers_ = nullptr;  ///< made with the first mark
    cudaEvent_t marked_ = nullptr, transferred_ = nullptr;
};

}  // namespace gs
