// SPDX-License-Identifier: Apache-2.0
// The time and work of the stages of a step, by marks on the device's clock.
#pragma once

#include <optional>

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

/// Adds up the times and work of stages. A mark in a graph holds up what follows by 2 to 4 us, so a step has one at its
/// beginning and one at the end of the stage whose turn it is: pass 0 has it at the beginning, pass k at the end of the
/// k-th stage. A stage takes as long as its end comes later than the one before. Marks are in all of these times alike,
/// and so in none of their differences.
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
    /// Adds the time between the marks of one step, which is done.
    void add() {
        float ms = 0;
        GS_CUDA(cudaEventElapsedTime(&ms, marks_[0], marks_[1]));
        seconds_[*pass] += 1e-3 * ms;
    }
    /// Adds the work of that step, which `moving` Gaussians took. A pair is one pixel and one Gaussian.
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
    double seconds_[kPasses] = {};  ///< from the beginning of steps to the mark of each pass
    double gaussians_ = 0, visible_ = 0, moving_ = 0, instances_ = 0, pairs_ = 0, pixels_ = 0, corrected_pixels_ = 0;
};

}  // namespace gs
