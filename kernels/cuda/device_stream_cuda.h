// SPDX-License-Identifier: Apache-2.0
// Ordered work of a CUDA device: a stream, as an interface for code that moves a rank's arrays, and kernels that are
// launched together. Only .cu files include this header.
#pragma once

#include "kernels/base/device_array.h"
#include "kernels/cuda/cuda.h"
#include "kernels/cuda/device_memory.h"

namespace gs {

/// A CUDA device, as an interface for code that moves a rank's arrays.
class CudaDeviceStream final : public DeviceStream {
  public:
    /// Uses `stream` of the current device; the stream must outlive the object.
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
            // Other ranks wait for the splats, but nothing waits yet for the work computed meanwhile.
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

/// Launches kernels that are enqueued together as one CUDA graph. In a stream a kernel begins about a microsecond after
/// the end of the previous one, which adds up in a step of twenty kernels; in a graph it begins sooner
/// (docs/lab/kernels.md#steps-as-graphs).
///
/// The graph is rebuilt for each launch, since most arguments differ, and updates the last one in place if both have
/// the same shape. The device must be busy meanwhile: work that is waited for at once is done sooner without a graph.
class LaunchGraph {
  public:
    LaunchGraph() = default;
    LaunchGraph(const LaunchGraph&) = delete;
    LaunchGraph& operator=(const LaunchGraph&) = delete;
    ~LaunchGraph() { forget(); }

    /// Calls enqueue(), which must not wait or allocate, and launches the work that it enqueues in `stream`. Throws
    /// DeviceError, and errors of enqueue(); nothing is launched then.
    template <class Fn> void run(cudaStream_t stream, Fn&& enqueue) {
        GS_CUDA(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal));
        Captured captured;
        try {
            enqueue();
        } catch (...) {
            cudaStreamEndCapture(stream, &captured.graph);
            cudaGetLastError();
            throw;
        }
        GS_CUDA(cudaStreamEndCapture(stream, &captured.graph));
        cudaGraphExecUpdateResultInfo result;
        if (launchable_ && cudaGraphExecUpdate(launchable_, captured.graph, &result) != cudaSuccess) {
            cudaGetLastError();
            forget();
        }
        if (!launchable_) GS_CUDA(cudaGraphInstantiate(&launchable_, captured.graph, 0));
        GS_CUDA(cudaGraphLaunch(launchable_, stream));
    }

  private:
    struct Captured {
        cudaGraph_t graph = nullptr;
        ~Captured() {
            if (graph) cudaGraphDestroy(graph);
        }
    };
    /// Discards the graph. A launch in progress completes normally.
    void forget() {
        if (launchable_) cudaGraphExecDestroy(launchable_);
        launchable_ = nullptr;
    }

    cudaGraphExec_t launchable_ = nullptr;
};

}  // namespace gs
