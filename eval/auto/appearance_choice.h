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

/// What a model without view dependence leaves.
enum class Remainder {
    kReflectance,   ///< it depends on the direction
    kPhotometric,   ///< whole images are brighter, darker or tinted
    kInconsistency, ///< what depends on the direction in some images is wrong in others: they contradict each other
    kUnresolved,    ///< none of these: detail that a short training has not reached
};

/// What a share of direction is worth, dB.
double worth(double direction);

Remainder what_remains(const ResidualParts& parts, double tolerance);

}  // namespace gs
