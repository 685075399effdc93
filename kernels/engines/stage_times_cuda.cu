// SPDX-License-Identifier: Apache-2.0
// Computes the costs of stages from their times and work.
#include "kernels/engines/stage_times_cuda.h"

#include <algorithm>

namespace gs {

std::vector<StageCost> StageTimes::take(const ResidualCost& residual) {
    const auto seconds = [&](CudaStage s) { return std::max(seconds_[int(s) + 1] - seconds_[int(s)], 0.0); };
    // The bytes are the minimum that each stage must read and write once. A splat has 48 bytes, its sums 36 of 48.
    // Radix sorts move key and value once a pass: three passes for the depth (8 bytes, visible Gaussians only, without
    // the first values and the last keys), two for the tile (6 bytes, without the last keys). Instructions as counted
    // in the templates: forward fragment_alpha 10, blending 9, and 120 to find the sub-tiles that an instance reaches;
    // backward fragment_alpha 7, since four pixels share the terms of dx, and 23 for the gradient and its sums.
    std::vector<StageCost> costs = {
        {"preprocess", seconds(CudaStage::kPreprocess), gaussians_, "Gaussian",
         gaussians_ * (44 + 8) + visible_ * (12 + 4 * residual.width + 48 + 8), visible_ * (260 + residual.operations),
         "", true},
        {"sort", seconds(CudaStage::kSort), instances_, "instance",
         gaussians_ * (4 + 4) + visible_ * (8 + 16 + 12 + 4 + 8) + instances_ * (6 + 12 + 10),
         visible_ * 20 + instances_ * 10,
         "five radix passes and four small kernels in a row: below a million keys each takes 5 to 13 us, most "
         "of it latency"},
        {"blend", seconds(CudaStage::kBlend), pairs_, "pixel x Gaussian", instances_ * (4 + 48 + 1 + 16) + pixels_ * 16,
         pairs_ * 19 + instances_ * 120,
         "a third of the instructions find and list splats, not counted in the floor; warps wait for the slowest of "
         "their block; long lists are walked by four blocks each"},
        {"loss", seconds(CudaStage::kLoss), pixels_, "pixel", pixels_ * (2 * (12 + 3) + 2 * 36 + 12),
         pixels_ * 3 * (110 + 110 + 40 + 66 + 10),
         "the separable filters read 27 values from shared memory per pixel and channel; a sixth of the instructions "
         "load tiles and their borders"},
        {"blend backward", seconds(CudaStage::kBlendBackward), pairs_, "pixel x Gaussian",
         instances_ * (4 + 48 + 1 + 16) + visible_ * 48 + pixels_ * 28, pairs_ * 30,
         "two fifths of the instructions begin lists, tell lanes what others pass on to them and bring columns of "
         "pixels together"},
        {"Gaussian backward + Adam", seconds(CudaStage::kUpdate), gaussians_, "Gaussian",
         gaussians_ * 4 + moving_ * 24 * 14 + visible_ * (residual.adam_bytes * residual.width + 48),
         visible_ * (500 + residual.operations_backward + 10 * residual.width) + moving_ * 140, "", true}};
    // A pixel takes as many instructions as on the CPU. Each of the four powers is a separate logarithm and
    // exponential.
    if (corrected_pixels_ > 0)
        costs.push_back({"PPISP", seconds(CudaStage::kCorrect) + seconds(CudaStage::kCorrectBackward),
                         corrected_pixels_, "pixel", corrected_pixels_ * 3 * 4 * 5, corrected_pixels_ * 770,
                         "five small kernels in a row, three of them of a single block"});
    std::fill(seconds_, seconds_ + kPasses, 0);
    gaussians_ = visible_ = moving_ = instances_ = pairs_ = pixels_ = corrected_pixels_ = 0;
    return costs;
}

}  // namespace gs
