// SPDX-License-Identifier: Apache-2.0
// The time and work of the stages of a step, by marks between them on the device's clock.
#pragma once

#include "kernels/cuda/cuda.h"
#include "kernels/requests.h"

namespace gs {

enum class CudaStage : int { kPreprocess, kSort, kBlend, kCorrect, kLoss, kCorrectBackward, kBlendBackward, kUpdate };
inline constexpr int kNumCudaStages = 8;

/// What a Gaussian's residual costs, on average.
struct ResidualCost {
    double width;                            ///< active parameters
    double adam_bytes;                       ///< that Adam reads and writes for each of them
    double operations, operations_backward;  ///< of evaluating it, and of its gradient
};

/// Adds up the times and work of stages.
class StageTimes {
  public:
    ~StageTimes() {
        for (cudaEvent_t e : marks_)
            if (e) cudaEventDestroy(e);
    }
    bool on = false;

    void begin(cudaStream_t stream) {
        if (on) record(0, stream);
    }
    void end(CudaStage stage, cudaStream_t stream) {
        if (on) record(int(stage) + 1, stream);
    }
    /// Adds the times between the marks of one step, which is done.
    void add() {
        for (int k = 0; k < kNumCudaStages; ++k) {
            float ms = 0;
            GS_CUDA(cudaEventElapsedTime(&ms, marks_[k], marks_[k + 1]));
            seconds_[k] += 1e-3 * ms;
        }
    }
    /// Adds the work of that step, which `moving` Gaussians took. A pair is one pixel and one Gaussian.
    void count(double gaussians, double visible, double moving, double instances, double pairs, double pixels,
               bool corrected) {
        gaussians_ += gaussians, visible_ += visible, moving_ += moving;
        instances_ += instances, pairs_ += pairs, pixels_ += pixels;
        if (corrected) corrected_pixels_ += pixels;
    }
    /// Returns the costs since the last call.
    std::vector<StageCost> take(const ResidualCost& residual);

  private:
    void record(int mark, cudaStream_t stream) {
        if (!marks_[mark]) GS_CUDA(cudaEventCreate(&marks_[mark]));
        cudaStreamCaptureStatus status;
        GS_CUDA(cudaStreamIsCapturing(stream, &status));
        GS_CUDA(cudaEventRecordWithFlags(
            marks_[mark], stream,
            status == cudaStreamCaptureStatusActive ? cudaEventRecordExternal : cudaEventRecordDefault));
    }
    cudaEvent_t marks_[kNumCudaStages + 1] = {};
    double seconds_[kNumCudaStages] = {}, gaussians_ = 0, visible_ = 0, moving_ = 0, instances_ = 0, pairs_ = 0,
           pixels_ = 0, corrected_pixels_ = 0;
};

}  // namespace gs
