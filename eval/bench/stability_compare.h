// SPDX-License-Identifier: Apache-2.0
// Evaluates one case in three precisions and adds the comparison to a row of the stability table.
#pragma once

#include <functional>
#include <span>

#include "eval/bench/stability.h"

namespace gs {

/// Inputs of a measured function. The 3 numbers from index `view` on form one vector (-1: no vector).
template <class T> struct StabilityInputs {
    std::vector<T> numbers;
    int view = -1;
};

/// A function of numbers in float, double and long double. Its results are widened, so that one comparison serves all
/// precisions.
struct StabilitySubject {
    using Results = std::vector<long double>;
    std::function<Results(const StabilityInputs<float>&)> in_float;
    std::function<Results(const StabilityInputs<double>&)> in_double;
    std::function<Results(const StabilityInputs<long double>&)> reference;
    std::vector<int> groups;  ///< group of each result; results of one group share their scale
    int first_gradient = 0;   ///< results from here on are gradients
    int num_compared = 0;     ///< results from here on only add to the scale of their group
};

/// Evaluates one case and adds it to the row. Returns the float results.
StabilitySubject::Results compare_case(const StabilitySubject& subject, const StabilityInputs<float>& inputs,
                                       StabilityRow& row);

/// Returns the values for the sweep of each raw parameter: 0, and with both signs the smallest float, the smallest
/// normal float, the decades 1e-6 ... 1e4, 1e10, 1e30 and the largest float.
std::span<const float> stability_sweep();

/// Returns "a at -max, b at +max".
std::string ends_text(double at_lowest, double at_highest);

/// Sweeps the named models in the order of the registry. Unregistered names are ignored.
std::vector<StabilityRow> measure_model_stability(const std::vector<std::string>& models);
/// Sweeps every colour activation: value and slope, then the inverse.
std::vector<StabilityRow> measure_activation_stability();

}  // namespace gs
