// SPDX-License-Identifier: Apache-2.0
// Kernels that are launched together. Only .cu files include this header.
#pragma once

#include "kernels/cuda/cuda.h"

namespace gs {

/// Launches what is enqueued together as one CUDA graph. In a stream a kernel begins about a microsecond after the one
/// before it has ended, which in a step of twenty kernels adds up; in a graph it begins sooner
/// (docs/lab/kernels.md#steps-as-graphs).
///
/// The graph is made anew for each launch, since most arguments differ, and takes the place of the last one where both
/// have the same shape. The device must be at work meanwhile: work that is waited for at once is sooner done without.
class LaunchGraph {
  public:
    LaunchGraph() = default;
    LaunchGraph(const LaunchGraph&) = delete;
    LaunchGraph& operator=(const LaunchGraph&) = delete;
    ~LaunchGraph() { forget(); }

    /// Calls enqueue(), which must not wait or allocate, and launches in `stream` what it enqueues there. Throws
    /// DeviceError, and what enqueue() throws; nothing is launched then.
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
    /// A launch that is under way ends as it would have.
    void forget() {
        if (launchable_) cudaGraphExecDestroy(launchable_);
        launchable_ = nullptr;
    }

    cudaGraphExec_t launchable_ = nullptr;
};

}  // namespace gs
