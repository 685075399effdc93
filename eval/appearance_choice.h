// SPDX-License-Identifier: Apache-2.0
// The rule of `--appearance auto`: from what short trainings measured to one model, and why.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace gs {

/// One model after its trial.
struct AppearanceTrial {
    std::string model;
    std::int64_t bytes = 0;     ///< of the appearance of one Gaussian, as trained
    double seconds = 0;         ///< of an iteration
    double psnr = 0;            ///< mean over the held-out views, dB; NaN or infinite = the trial failed
    double train_psnr = 0;      ///< the same over as many views that were trained on
    double error = 0;           ///< mean squared difference over the held-out views
    double aligned_error = 0;   ///< the same after the colours of each view were fitted to its photograph
};

/// What is left where no direction explains it.
enum class Remainder {
    kReflectance,   ///< a model that depends on the direction does explain it
    kPhotometric,   ///< whole images are brighter, darker or tinted
    kInconsistency, ///< models learn it from the images they see, and are wrong about others: images contradict each other
    kUnresolved,    ///< none of these: detail that a short training has not reached
};

struct AppearanceChoice {
    std::size_t chosen = 0, best = 0;  ///< indices into the trials
    /// Shares of the held-out squared error of the first trial; they add up to 1.
    double direction = 0, photometric = 0, neither = 1;
    /// What the best model gains on the views it was trained on and on those held out, dB over the first trial; where that is the best itself,
    /// of the model that gains most on the former.
    double train_gain = 0, held_out_gain = 0;
    Remainder remainder = Remainder::kUnresolved;
};

/// Keeps the model of fewest bytes, then of least time, whose PSNR is at most `tolerance` dB below the best. `trials`: at least one, the first
/// without view dependence, whose error the shares refer to. Trials that failed are passed over; where all did, the first is kept.
/// Direction is what the best model's error is smaller by, photometric change what a fit of its colours then takes off.
AppearanceChoice choose_appearance(const std::vector<AppearanceTrial>& trials, double tolerance);

}  // namespace gs
