// SPDX-License-Identifier: Apache-2.0
// The time and work of the stages of a step, measured by marks on the device's clock.
#pragma once

#include <optional>

#include "kernels/cuda/cuda.h"
#include "kernels/requests.h"

namespace gs {

enum class CudaStage : int { kPreprocess, kSort, kBlend, kCorrect, kLoss, kCorrectBackward, kBlendBackward, kUpdate };
inline constexpr int kNumCudaStages = 8;

/// The mean cost of a Gaussian's residual.
struct ResidualCost {
    double width;                            ///< active parameters
    double adam_bytes;                       ///< bytes that Adam reads and writes per active parameter
    double operations, operations_backward;  ///< instructions for evaluation, and for its gradient
};

/// Adds up the times and work of stages. A mark in a graph delays the work after it by 2 to 4 us, so a step has only
/// one mark at its beginning and one more: pass 0 has it at the beginning, pass k at the end of the k-th stage. The
/// time of a stage is the time of its end minus the time of the end before it. All of these times include the same
/// marks, so the differences include none.
class StageTimes {
  public:
    ~StageTimes() {
        for (cudaEvent_t e : marks_)
            if (e) cudaEventDestroy(e);
    }
    static constexpr int kPasses = kNumCudaStages + 1;
    std::optional<int> pass;

    void begin(cudaStream_t stream) {
        if (!pass) return;
        record(0, stream);
        if (pass == 0) record(1, stream);
    }
    void end(CudaStage stage, cudaStream_t stream) {
        if (pass == int(stage) + 1) record(1, stream);
    }
    /// Adds the time between the marks of one completed step.
    void add() {
        float ms = 0;
        GS_CUDA(cudaEventElapsedTime(&ms, marks_[0], marks_[1]));
        seconds_[*pass] += 1e-3 * ms;
    }
    /// Adds the work of that step, in which `moving` Gaussians were updated. A pair is one pixel and one Gaussian.
    void count(double gaussians, double visible, double moving, double instances, double pairs, double pixels,
               bool corrected) {
        if (pass != 0) return;  // the steps of each pass are the same
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
    cudaEvent_t marks_[2] = {};
    double seconds_[kPasses] = {};  ///< time from the beginning of steps to the mark of each pass
    double gaussians_ = 0, visible_ = 0, moving_ = 0, instances_ = 0, pairs_ = 0, pixels_ = 0, corrected_pixels_ = 0;
};

}  // namespace gs
