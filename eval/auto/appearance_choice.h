// SPDX-License-Identifier: Apache-2.0
// The rules of `--appearance auto`: from what was measured to what it means, and to one model.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "eval/auto/residual_parts.h"

namespace gs {

/// One model after its trial.
struct AppearanceTrial {
    std::string model;
    std::int64_t bytes = 0;     ///< of the appearance of one Gaussian, as trained
    double seconds = 0;         ///< of an iteration
    double psnr = 0;            ///< mean over the held-out views, dB; NaN or infinite = the trial failed
};

struct AppearanceChoice {
    std::size_t chosen = 0, best = 0;  ///< indices into the trials
};

/// Keeps the model of fewest bytes, then of least time, whose PSNR is at most `tolerance` dB below the best. `trials`: at least one. Those that failed are
/// passed over; where all did, the first is kept.
AppearanceChoice choose_appearance(const std::vector<AppearanceTrial>& trials, double tolerance);

/// What the error of a model without view dependence is made of.
enum class RemainingError {
    kReflectance,   ///< it depends on the direction
    kPhotometric,   ///< whole images are brighter, darker or tinted
    kInconsistency, ///< what depends on the direction in some images is wrong in others: they contradict each other
    kUnresolved,    ///< none of these: detail that a short training has not reached
};

/// The rise of PSNR, in dB, if this share of the squared error went away.
double gain_in_decibels(double share);

/// `tolerance`: the rise of PSNR, in dB, from which direction counts as a cause.
RemainingError classify_remaining_error(const ResidualParts& parts, double tolerance);

}  // namespace gs
