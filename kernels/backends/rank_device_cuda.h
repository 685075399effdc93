// SPDX-License-Identifier: Apache-2.0
// A CUDA device as a rank shows it to those who move its arrays. Only .cu files include this header.
#pragma once

#include "kernels/cuda/device_memory.h"
#include "kernels/ranks/rank_device.h"

namespace gs {

class CudaRankDevice final : public RankDevice {
  public:
    /// Works on a stream, which must outlive it, of the device that is current.
    explicit CudaRankDevice(cudaStream_t stream) : stream_(stream) {}

    std::unique_ptr<DeviceBlock> make_block() override { return std::make_unique<Block>(); }
    void copy(void* to, const void* from, std::size_t bytes) override {
        GS_CUDA(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDefault, stream_));
    }
    bool is_idle() override {
        const cudaError_t status = cudaStreamQuery(stream_);
        if (status == cudaErrorNotReady) {
            cudaGetLastError();  // is no error, but would be the last one
            return false;
        }
        cuda_check(status, "cudaStreamQuery(stream_)");
        return true;
    }
    void wait() override { GS_CUDA(cudaStreamSynchronize(stream_)); }
    void* stream() override { return stream_; }

  private:
    class Block final : public DeviceBlock {
      public:
        std::byte* reserve(std::size_t bytes) override { return buffer_.reserve(bytes); }

      private:
        DeviceBuffer<std::byte> buffer_;
    };

    const cudaStream_t stream_;
};

}  // namespace gs
