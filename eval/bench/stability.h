// SPDX-License-Identifier: Apache-2.0
// Measures the numerical stability of the appearance models and colour activations at extreme inputs: compares float
// and double with an 80-bit evaluation of the same templates, and with exact limits if a model defines them.
//
// Error measures. A component x (a channel of a colour, one gradient) is compared with its reference X in one of two
// scales; X_max is the largest reference of the same kind (the three channels, the gradients of all columns of one
// kind, the gradient of the mean):
//  - The relative error is |x - X| / (|X| + X_max). It is measured only if the inputs determine X to three digits: one
//    rounding of all inputs moves X by less than a thousandth of the scale. It includes the conditioning of the
//    problem: with a site of temperature 1e4 a rounding of the direction alone changes a weight by a thousandth.
//  - The ULP error is |x - X| in spacings of float at |X| + X_max + condition, where the condition is the change of X
//    per relative change of the inputs. It measures the algorithm alone: small numbers mean that the result is nearly
//    correct for inputs close to the given ones, which is the best that finite precision can guarantee.
// Both scales have a floor of 1e-30, below which float underflows. The mean's offset is perturbed as a vector: each
// component by the same share of its length.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "eval/pages/text_table.h"

namespace gs {

/// The errors of one model (or activation) for one kind of input.
struct StabilityRow {
    std::string model, kind;
    std::int64_t cases = 0;
    double forward_error = 0, backward_error = 0;    ///< largest relative error of the float evaluation
    double ulp = 0;                                  ///< largest error of the float evaluation in ULP
    double double_error = 0;                         ///< largest error of the double evaluation in the scale of the ULP
    std::int64_t num_values = 0, num_nonfinite = 0;  ///< float values, and how many are not finite
    /// Number of gradients with the wrong sign in float although the reference is larger than rounding can explain.
    /// Zero has no sign.
    std::int64_t num_sign_flips = 0;
    std::int64_t num_wrong_limits = 0;  ///< number of exact limits that float misses by more than 0.03 %
    std::string limit;                  ///< values reached at both ends, for readers
};

/// Sweeps every registered model and every colour activation, which takes seconds. The seeds are fixed: machines with
/// the same mathematics library return the same rows.
std::vector<StabilityRow> measure_stability();

/// Sweeps every colour activation and the named models. Unregistered names are ignored.
std::vector<StabilityRow> measure_stability(const std::vector<std::string>& models);

/// Returns the rows as a table.
TextTable stability_table(const std::vector<StabilityRow>& rows);

/// Returns the rows as JSON.
std::string stability_json(const std::vector<StabilityRow>& rows);

}  // namespace gs
