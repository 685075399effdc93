// SPDX-License-Identifier: Apache-2.0
// The grids.
#include "eval/experiments/suite.h"

#include <fmt/format.h>

#include <functional>
#include <limits>

#include "eval/experiments/cell.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

struct Row {
    std::string name, folder;
    std::function<void(TrainOptions&)> vary;
};

std::vector<Row> densification_rows() {
    const auto strategy = [](Strategy rule, bool speedy) {
        return [=](TrainOptions& o) { o.strategy = rule, o.speedy_splat = speedy; };
    };
    const auto tenth = [](TrainOptions& o) {
        o.strategy = Strategy::kMcmc, o.speedy_splat = false;
        limit_budget(o, 0.1);
    };
    return {{"MCMC", "mcmc", strategy(Strategy::kMcmc, false)},
            {"MCMC 0.1x", "mcmc-0.1x", tenth},
            {"ADC", "adc", strategy(Strategy::kAdc, false)},
            {"ADC + Speedy-Splat", "adc-speedy", strategy(Strategy::kAdc, true)}};
}

std::vector<Row> activation_rows() {
    struct Rate {
        const char* name;
        double value;
    };
    constexpr Rate kRates[] = {{"0.05", 0.05}, {"0.025", 0.025}, {"auto", std::numeric_limits<double>::quiet_NaN()}};
    std::vector<Row> rows;
    for (const std::string& activation : words<ColorActivation>())
        for (const Rate& rate : kRates)
            rows.push_back({fmt::format("{}, opacity rate {}", activation, rate.name),
                            fmt::format("{}-{}", activation, rate.name),
                            [kind = *choice_of<ColorActivation>(activation), value = rate.value](TrainOptions& o) {
                                o.color_activation = kind, o.opacity_lr = value;
                            }});
    return rows;
}

struct Suite {
    const char* name;
    std::vector<Row> (*rows)();
};
constexpr Suite kSuites[] = {{"densification", densification_rows}, {"activations", activation_rows}};

std::vector<Row> rows_of(const std::string& suite) {
    for (const Suite& s : kSuites)
        if (s.name == suite) return s.rows();
    throw UsageError(fmt::format("suite: '{}' is not one of {}", suite, fmt::join(suite_names(), ", ")));
}

}  // namespace

std::vector<std::string> suite_names() {
    std::vector<std::string> names;
    for (const Suite& suite : kSuites) names.push_back(suite.name);
    return names;
}

std::vector<SuiteLine> suite_lines(const std::string& suite, const std::vector<std::string>& appearances,
                                   const TrainOptions& base) {
    std::vector<SuiteLine> lines;
    for (const std::string& appearance : appearances)
        for (const Row& row : rows_of(suite)) {
            TrainOptions options = base;
            options.appearance = appearance;
            options.eval = true;
            set_folder(options, fs::path(base.model) / (row.folder + "-" + appearance));
            row.vary(options);
            require_named_appearance(options);
            validate(options);
            lines.push_back({row.name, appearance, {fmt::format("{}, {}", row.name, appearance), std::move(options)}});
        }
    return lines;
}

}  // namespace gs
