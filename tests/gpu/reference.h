// SPDX-License-Identifier: Apache-2.0
// What a render and an optimizer step should give, in double (CpuRasterizer<double>, ImageLoss<double>), and how far
// single precision may be from it. noisy_loss (reference.cpp) repeats ImageLoss: change both.
//
// Images have bounds that no fp32 evaluation may exceed: the templates on Rounded (rounding.h). A fragment whose alpha
// lies within its error of 1/255, or whose pixel's transmittance lies within its error of 1e-4, may be blended or not:
// its whole contribution counts as error of the pixel.
//
// Gradients and losses have the spread of four evaluations of the templates on Noisy (noisy.h), with the larger steps
// that sums take on a device (noise_of_sum in reference.cpp). Their allowance is kSpread times the root mean square of
// a Gaussian's largest component in a group. Four samples underestimate a standard deviation to a tenth once in 5000
// cases, and errors of three standard deviations are usual among thousands of numbers: 30, and the rest for what rounds
// in one direction only (the tensor cores of neural models cut off). Fragments at a threshold that no sample decides
// the other way are not in it; kBeyond of the numbers may be beyond their allowance for that.
#pragma once

#include <array>
#include <vector>

#include "kernels/ranks/backend.h"
#include "tests/gpu/rounding.h"

namespace gs::test {

inline constexpr int kSamples = 4;
inline constexpr double kSpread = 64;
inline constexpr double kBeyond = 2e-3;

struct RenderReference {
    std::vector<Rounded> rgb, alpha;    ///< planar (3,H,W), (H,W)
    std::vector<char> seen;             ///< a pixel shows the Gaussian, whatever rounding does
    std::int64_t undecided_pixels = 0;  ///< with a fragment that may be blended or not
};

/// The results of a step, as values with their allowances.
struct StepReference {
    std::array<std::vector<Rounded>, kNumGroups>
        gradient;                    ///< of the loss with its regularisers, rows as in GaussianState
    std::vector<Rounded> statistic;  ///< of densification: norm of the screen-space gradient
    Rounded l1, ssim, loss;
};

/// Renders a view of the models `none` and `sh` with error bounds.
RenderReference reference_render(const Gaussians& model, const RenderRequest& request);
/// Takes a step with error bounds; needs about 0.5 us for each fragment on all cores.
StepReference reference_step(const Gaussians& model, const StepRequest& request);

}  // namespace gs::test
