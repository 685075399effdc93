// SPDX-License-Identifier: Apache-2.0
// The counters of a step on the device.
#pragma once

#include <cstddef>

namespace gs {

/// The counters of the current step, on the device. All except `stopped` are zeroed before every step.
struct StepControl {
    unsigned long long num_instances;  ///< Gaussian-tile pairs
    unsigned long long num_pairs;      ///< Gaussian-pixel pairs that were blended
    unsigned num_visible;
    unsigned num_large, num_huge;  ///< number of Gaussians with more than 32 candidate tiles, by instances
    unsigned num_chunks;           ///< chunks of the blend
    unsigned num_nonfinite;        ///< Gaussians whose gradient was left out
    unsigned loss_not_finite;      ///< nonzero if a block's loss sum is not finite; the step then changes nothing
    unsigned stopped;              ///< set if instances did not fit; no step updates until the host has made room

    __device__ bool takes_no_step() const { return stopped || loss_not_finite; }
};
inline constexpr int kControlWords = offsetof(StepControl, stopped) / sizeof(unsigned);  ///< words to zero

}  // namespace gs
