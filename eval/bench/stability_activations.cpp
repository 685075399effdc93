// SPDX-License-Identifier: Apache-2.0
// Measures the stability of the colour activations: value, slope and inverse.
#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "appearance/contract.h"
#include "eval/bench/stability_compare.h"
#include "lib/core/choices.h"

namespace gs {
namespace {

constexpr ColorActivation kActivations[] = {ColorActivation::kRelu, ColorActivation::kSoftplus,
                                            ColorActivation::kSigmoid, ColorActivation::kHardSigmoid};

template <class Function> StabilitySubject subject(std::vector<int> groups, int first_gradient, Function f) {
    const int count = int(groups.size());
    return {f, f, f, std::move(groups), first_gradient, count};
}

StabilityRow row(const std::string& activation, std::string kind) {
    StabilityRow r;
    r.model = activation, r.kind = std::move(kind);
    return r;
}

/// Returns the values of the sweep, values around the corners of relu and hardsigmoid, and values at which the smooth
/// activations saturate.
std::vector<float> pre_activations() {
    std::vector<float> y(stability_sweep().begin(), stability_sweep().end());
    for (const float corner : {-0.5f, 0.5f})
        for (const float step : {-1e-3f, -1e-6f, 0.0f, 1e-6f, 1e-3f}) {
            y.push_back(corner + step);
            y.push_back(std::nextafter(corner + step, 9.0f));
            y.push_back(std::nextafter(corner + step, -9.0f));
        }
    for (float x = 1; x < 30; x += 0.37f) y.insert(y.end(), {x, -x});
    return y;
}

}  // namespace

std::vector<StabilityRow> measure_activation_stability() {
    std::vector<StabilityRow> rows;
    for (const ColorActivation activation : kActivations) {
        const std::string name = word(activation);
        const auto forward = subject({0, 1}, 1, [kind = activation]<class T>(const StabilityInputs<T>& in) {
            return StabilitySubject::Results{color_activation(kind, in.numbers[0]),
                                             color_activation_derivative(kind, in.numbers[0])};
        });
        StabilityRow base = row(name, "base colour");
        for (const float y : pre_activations()) compare_case(forward, {{y}}, base);
        constexpr float kMax = std::numeric_limits<float>::max();
        base.limit = ends_text(color_activation(activation, -kMax), color_activation(activation, kMax));
        rows.push_back(base);

        const auto inverse = subject({0}, 1, [kind = activation]<class T>(const StabilityInputs<T>& in) {
            return StabilitySubject::Results{inverse_color_activation(kind, in.numbers[0])};
        });
        StabilityRow initial = row(name, "initial colour");
        for (int c = 0; c <= 255; ++c) compare_case(inverse, {{float(c) / 255}}, initial);
        for (const float c : {std::numeric_limits<float>::denorm_min(), 1e-6f, 1 - 1e-6f})
            compare_case(inverse, {{c}}, initial);
        initial.limit = fmt::format("{:.3g} for black, {:.3g} for white", inverse_color_activation(activation, 0.0f),
                                    inverse_color_activation(activation, 1.0f));
        rows.push_back(initial);
    }
    return rows;
}

}  // namespace gs
