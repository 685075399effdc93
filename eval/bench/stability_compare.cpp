// SPDX-License-Identifier: Apache-2.0
// Computes the errors of the stability measurement in the scales that stability.h defines.
#include "eval/bench/stability_compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "appearance/model_info.h"

namespace gs {
namespace {

using Real = long double;
using Results = StabilitySubject::Results;

/// Relative change of an input by rounding: half a spacing of float.
constexpr Real kRounding = 0x1p-24L;
/// Floor of both scales: below it, products of a few factors underflow in float.
constexpr Real kFloor = 1e-30L;
/// Smallest ratio of a value's scale to its change by one rounding of the inputs for which the relative error counts.
constexpr Real kDetermined = 1000;
/// Number of perturbations: enough to approach the worst case for a few inputs, cheap enough for 1e5 cases.
constexpr int kPerturbations = 8;

template <class T> StabilityInputs<T> widened(const StabilityInputs<float>& in) {
    return {{in.numbers.begin(), in.numbers.end()}, in.view};
}

/// Moves every number by one rounding. The first two samples move all numbers in one direction, so that a limit of any
/// single parameter is crossed.
StabilityInputs<Real> perturbed(StabilityInputs<Real> in, int sample, std::mt19937& signs) {
    const auto turn = [&] { return sample == 0 || (sample > 1 && signs() % 2) ? kRounding : -kRounding; };
    Real length = 0;
    if (in.view >= 0 && sample > 1)
        length = std::hypot(in.numbers[in.view], in.numbers[in.view + 1], in.numbers[in.view + 2]);
    for (int k = 0; k < int(in.numbers.size()); ++k) {
        const bool of_view = in.view >= 0 && k >= in.view && k < in.view + 3;
        in.numbers[k] += turn() * (of_view && sample > 1 ? length : std::abs(in.numbers[k]));
    }
    return in;
}

/// Returns the largest change of each result under one rounding of the inputs.
Results response(const StabilitySubject& subject, const StabilityInputs<Real>& inputs, const Results& exact) {
    std::mt19937 signs(1);
    Results noise(exact.size(), 0);
    for (int sample = 0; sample < kPerturbations; ++sample) {
        const Results moved = subject.reference(perturbed(inputs, sample, signs));
        for (std::size_t c = 0; c < exact.size(); ++c) noise[c] = std::max(noise[c], std::abs(moved[c] - exact[c]));
    }
    return noise;
}

Results group_maxima(const Results& values, const std::vector<int>& groups) {
    Results largest(1 + *std::max_element(groups.begin(), groups.end()), 0);
    for (std::size_t c = 0; c < values.size(); ++c)
        largest[groups[c]] = std::max(largest[groups[c]], std::abs(values[c]));
    Results out;
    for (const int g : groups) out.push_back(largest[g]);
    return out;
}

/// Returns the spacing at x of floating-point numbers with `digits` binary digits.
Real spacing(Real x, int digits) { return std::ldexp(Real(1), std::ilogb(x) + 1 - digits); }

}  // namespace

Results compare_case(const StabilitySubject& subject, const StabilityInputs<float>& inputs, StabilityRow& row) {
    const StabilityInputs<Real> wide = widened<Real>(inputs);
    const Results exact = subject.reference(wide), in_float = subject.in_float(inputs),
                  in_double = subject.in_double(widened<double>(inputs));
    const Results noise = response(subject, wide, exact), largest = group_maxima(exact, subject.groups);
    ++row.cases;
    for (int c = 0; c < subject.num_compared; ++c) {
        const Real error = std::abs(in_float[c] - exact[c]), scale = std::abs(exact[c]) + largest[c] + kFloor,
                   condition = scale + noise[c] / kRounding;
        ++row.num_values;
        if (!std::isfinite(in_float[c])) {
            ++row.num_nonfinite;
            continue;
        }
        const bool gradient = c >= subject.first_gradient;
        if (kDetermined * noise[c] < scale) {
            double& worst = gradient ? row.backward_error : row.forward_error;
            worst = std::max(worst, double(error / scale));
        }
        row.ulp = std::max(row.ulp, double(error / spacing(condition, 24)));
        row.double_error = std::max(row.double_error, double(std::abs(in_double[c] - exact[c]) / condition));
        const bool certain = std::abs(exact[c]) > 4 * noise[c] + 8 * kRounding * largest[c] + kFloor;
        if (gradient && certain && in_float[c] * exact[c] < 0) ++row.num_sign_flips;
    }
    return in_float;
}

std::span<const float> stability_sweep() {
    static const std::vector<float> values = [] {
        using Limits = std::numeric_limits<float>;
        std::vector<float> v = {0, Limits::denorm_min(), Limits::min()};
        for (int decade = -6; decade <= 4; ++decade) v.push_back(std::pow(10.0f, float(decade)));
        v.insert(v.end(), {1e10f, 1e30f, Limits::max()});
        for (std::size_t k = 1, n = v.size(); k < n; ++k) v.push_back(-v[k]);
        return v;
    }();
    return values;
}

std::string ends_text(double at_lowest, double at_highest) {
    return fmt::format("{:.3g} at -max, {:.3g} at +max", at_lowest, at_highest);
}

std::vector<StabilityRow> measure_stability() { return measure_stability(appearance_names()); }

std::vector<StabilityRow> measure_stability(const std::vector<std::string>& models) {
    std::vector<StabilityRow> rows = measure_activation_stability();
    for (StabilityRow& row : measure_model_stability(models)) rows.push_back(std::move(row));
    return rows;
}

}  // namespace gs
