// SPDX-License-Identifier: Apache-2.0
// Rounds of a grid and of successive halving.
#include "eval/experiments/tradeoff_rounds.h"

#include <fmt/format.h>

#include <algorithm>

#include "kernels/base/error.h"

namespace gs {
namespace {

/// What --iterations is divided by in each round.
constexpr std::int64_t kDivisors[] = {4, 2, 1};

}  // namespace

Rounds plan_grid(std::vector<std::string> words, const TrainOptions& base, std::vector<TradeoffAxis>& axes) {
    if (words.empty()) words = {"appearance,budget,iterations"};
    axes = parse_axes(words, base);
    return {spread_grid(axes, base)};
}

Rounds plan_halving(std::vector<std::string> words, const TrainOptions& base, std::vector<TradeoffAxis>& axes) {
    if (words.empty()) words = {"appearance,budget"};
    axes = parse_axes(words, base);
    if (std::any_of(axes.begin(), axes.end(), [](const TradeoffAxis& axis) { return axis.name == "iterations"; }))
        throw UsageError("--axes iterations: --search halving varies the iterations itself, up to --iterations");
    if (base.iterations < kDivisors[0])
        throw UsageError(fmt::format("--search halving: needs at least {} --iterations", kDivisors[0]));
    axes.push_back({"iterations", {std::to_string(base.iterations)}});
    const std::vector<Configuration> full = spread_grid(axes, base);
    axes.back().values.clear();
    Rounds rounds;
    for (const std::int64_t divisor : kDivisors) {
        const std::string iterations = std::to_string((base.iterations + divisor - 1) / divisor);
        axes.back().values.push_back(iterations);
        rounds.emplace_back();
        for (const Configuration& configuration : full) {
            std::vector<std::string> values = configuration.values;
            values.back() = iterations;
            rounds.back().push_back(make_configuration(axes, values, base));
        }
    }
    return rounds;
}

}  // namespace gs
