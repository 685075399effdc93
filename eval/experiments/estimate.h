// SPDX-License-Identifier: Apache-2.0
// What a shorter training and fewer Gaussians cost, by what they cost on the scenes of
// docs/lab/limits.md#what-the-plan-estimates.
#pragma once

#include <cstdint>
#include <string>

namespace gs {

/// Returns the PSNR that training by recipe frontier gives up against the same with all the time it can use, dB, where
/// each view is seen `rounds` > 0 times.
double loss_of_length(double rounds);

/// Returns the PSNR that a model of `count` > 0 Gaussians gives up against one of `most`, dB, where the scene has
/// detail enough for `most`.
double loss_of_count(std::int64_t count, std::int64_t most);

/// Puts a loss into words: "about 0.3 dB", "less than 0.1 dB", "more than 10 dB".
std::string about(double loss);

}  // namespace gs
