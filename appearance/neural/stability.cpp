// SPDX-License-Identifier: Apache-2.0
// The degenerate networks that the stability measurement tries.
#include "appearance/neural/stability.h"

#include <algorithm>
#include <cmath>

#include "appearance/neural/neural.h"

namespace gs::appearance {
namespace {

/// Returns features, then weights. The inner weights are all `inner` (0: waves of both signs), those of the output all
/// `output` with a sign per channel.
template <class Model> std::vector<double> network(double inner, double output) {
    std::vector<double> numbers(Model::kMaxResidual + Model::kNumShared);
    double* weights = numbers.data() + Model::kMaxResidual;
    for (int k = 0; k < Model::kMaxResidual; ++k) numbers[k] = std::sin(k + 1.0);
    for (int k = 0; k < Model::kFirstOutput; ++k) weights[k] = inner != 0 ? inner : 0.3 * std::sin(0.7 * k * k);
    for (int k = Model::kFirstOutput; k < Model::kNumShared; ++k)
        weights[k] = (k - Model::kFirstOutput) / Model::kNeurons % 2 ? output : -output;
    return numbers;
}

}  // namespace

template <class Model> StabilityPlan network_stability() {
    StabilityPlan plan;
    plan.column_kinds.assign(Model::kMaxResidual, "features");
    const std::array<double, 3> views[] = {{0.3, 0.8, -0.4}, {-0.5, -0.2, 0.9}, {0, 0, 1}, {1e-8, 1, 0}};
    for (const auto& view : views) {
        // Inner weights of 0 put every neuron exactly at its corner.
        auto corner = network<Model>(0, 0.5);
        std::fill(corner.begin() + Model::kMaxResidual, corner.begin() + Model::kMaxResidual + Model::kFirstOutput,
                  0.0);
        plan.cases.push_back({"neurons at 0", corner, view, std::array<double, 3>{}, "residual"});
        for (const double inner : {-1e4, -0.2, 0.2, 1e4})
            plan.cases.push_back({"neurons all off or on", network<Model>(inner, 0.1), view, {}, {}});
        // Outputs go from ordinary ones through |o| = 9, where tanh is 1 in float, to far beyond 43, where its slope
        // underflows.
        for (const double output : {0.5, 2., 5., 10., 20., 40., 100., 1e4})
            plan.cases.push_back({"saturated output", network<Model>(0, output), view, {}, {}});
    }
    return plan;
}

template StabilityPlan network_stability<Neural>();
template StabilityPlan network_stability<NeuralOneLayer>();
template StabilityPlan network_stability<NeuralThreeLayers>();
template StabilityPlan network_stability<NeuralWide>();
template StabilityPlan network_stability<NeuralPlain>();

}  // namespace gs::appearance
