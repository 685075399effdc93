// SPDX-License-Identifier: Apache-2.0
// Parses axes, and orders the configurations they span.
#include "eval/experiments/tradeoff_axes.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <sstream>

#include "eval/bench/precision.h"
#include "eval/experiments/job.h"
#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "lib/core/nearest.h"
#include "lib/core/options.h"
#include "lib/core/quantities.h"
#include "lib/train/choose_backend.h"

namespace gs {
namespace {

constexpr const char* kBudget = "budget";
constexpr const char* kPrecision = "precision";
constexpr std::size_t kMaxConfigurations = 1000;  // a longer list is a typing error, not a plan

std::vector<std::string> split(const std::string& text) {
    std::vector<std::string> parts;
    std::istringstream stream(text);
    for (std::string part; std::getline(stream, part, ',');)
        if (!part.empty()) parts.push_back(part);
    return parts;
}

bool is_number(const std::string& text, double& value) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc{} && end == text.data() + text.size() && std::isfinite(value);
}

const Option* find_option(const std::string& name) {
    const auto& table = train_option_table();
    const auto found =
        std::find_if(table.begin(), table.end(), [&](const Option& option) { return option.key == name; });
    return found == table.end() ? nullptr : &*found;
}

void check_name(const std::string& name) {
    if (name == kBudget || name == kPrecision) return;
    const Option* option = find_option(name);
    if (option && option->scope == Scope::kExperiment) return;
    if (option)
        throw UsageError(fmt::format(
            "--axes: '{}' cannot be an axis: runs with other values of it would not compare, or not differ", name));
    std::vector<std::string> known = {kBudget, kPrecision};
    for (const Option& o : train_option_table())
        if (o.scope == Scope::kExperiment) known.push_back(o.key);
    throw UsageError(fmt::format("--axes: unknown axis '{}'{}", name, did_you_mean(name, known)));
}

std::vector<std::string> default_values(const std::string& name, const TrainOptions& base) {
    if (name == kBudget) return {"0.1", "0.3", "1"};
    if (name == kPrecision)
        return uses_cuda(base.device) ? std::vector<std::string>{"full", "fast"}
                                      : std::vector<std::string>{"full", "cutoffs"};
    if (name == "appearance") return {"none", "nasg", "neural", "sh"};
    if (name == "iterations")
        return {std::to_string(std::max<std::int64_t>(1, base.iterations / 4)), std::to_string(base.iterations)};
    const Option& option = *find_option(name);
    if (std::holds_alternative<bool TrainOptions::*>(option.field)) return {"false", "true"};
    if (option.choices.empty())
        throw UsageError(
            fmt::format("--axes: {} has no default values; write {}=A,B ({})", name, name, option_range(option)));
    return option.choices;
}

double parse_share(const std::string& text) {
    double share = 0;
    if (!is_number(text, share) || !(share > 0 && share <= 1))
        throw UsageError(fmt::format("--axes budget: '{}' is not a share of --cap-max above 0 and up to 1", text));
    return share;
}

void apply_precision(TrainOptions& options, const std::string& name) {
    const PrecisionLevel& level = precision_level(name);
    if (level.gpu_only && !uses_cuda(options.device))
        throw UsageError(
            fmt::format("--axes precision: '{}' is a choice on a GPU only; the CPU computes in fp32", name));
    level.apply(options);
}

std::string folder_name(const std::vector<TradeoffAxis>& axes, const std::vector<std::string>& values) {
    std::string name;
    for (std::size_t a = 0; a < axes.size(); ++a)
        name += fmt::format("{}{}-{}", a > 0 ? "_" : "", axes[a].name, values[a]);
    std::replace(name.begin(), name.end(), '/', '-');
    return name;
}

/// Returns the distance of two values of an axis, from 0 to 1. Numbers are compared by their ranks among the axis's
/// values; words are either equal or not.
double distance_on(const TradeoffAxis& axis, const std::string& a, const std::string& b) {
    if (a == b) return 0;
    std::vector<double> numbers;
    for (const std::string& value : axis.values)
        if (!is_number(value, numbers.emplace_back())) return 1;
    std::sort(numbers.begin(), numbers.end());
    double of_a = 0, of_b = 0;
    is_number(a, of_a), is_number(b, of_b);
    const auto place = [&](double v) {
        return double(std::lower_bound(numbers.begin(), numbers.end(), v) - numbers.begin());
    };
    return std::abs(place(of_a) - place(of_b)) / double(numbers.size() - 1);
}

void spread(const std::vector<TradeoffAxis>& axes, std::vector<Configuration>& list) {
    const auto work = [](const Configuration& c) {
        const TrainOptions& o = c.options;
        if (o.time_limit) return o.time_limit->seconds;
        return double(o.iterations) * double(o.cap_max);
    };
    std::iter_swap(list.begin(), std::min_element(list.begin(), list.end(),
                                                  [&](const auto& a, const auto& b) { return work(a) < work(b); }));
    // Distances to the nearest earlier configuration.
    std::vector<double> nearest(list.size(), std::numeric_limits<double>::infinity());
    for (std::size_t k = 1; k < list.size(); ++k) {
        for (std::size_t i = k; i < list.size(); ++i) {
            double distance = 0;
            for (std::size_t a = 0; a < axes.size(); ++a)
                distance += distance_on(axes[a], list[i].values[a], list[k - 1].values[a]);
            nearest[i] = std::min(nearest[i], distance);
        }
        const auto farthest =
            std::size_t(std::max_element(nearest.begin() + std::ptrdiff_t(k), nearest.end()) - nearest.begin());
        std::swap(list[k], list[farthest]);
        std::swap(nearest[k], nearest[farthest]);
    }
}

}  // namespace

std::vector<TradeoffAxis> parse_axes(const std::vector<std::string>& words, const TrainOptions& base) {
    std::vector<TradeoffAxis> axes;
    const auto add = [&](std::string name, const std::optional<std::vector<std::string>>& values) {
        std::replace(name.begin(), name.end(), '_', '-');
        if (name == "time" || name == "size") name += "-limit";
        check_name(name);
        if (std::any_of(axes.begin(), axes.end(), [&](const TradeoffAxis& axis) { return axis.name == name; }))
            throw UsageError(fmt::format("--axes: {} is given twice", name));
        axes.push_back({name, values ? *values : default_values(name, base)});
        if (axes.back().values.empty()) throw UsageError(fmt::format("--axes: {} has no values", name));
    };
    for (const std::string& word : words) {
        const std::size_t equals = word.find('=');
        if (equals != std::string::npos) {
            add(word.substr(0, equals), split(word.substr(equals + 1)));
        } else {
            for (const std::string& name : split(word)) add(name, std::nullopt);
        }
    }
    return axes;
}

Configuration make_configuration(const std::vector<TradeoffAxis>& axes, const std::vector<std::string>& values,
                                 const TrainOptions& base) {
    Configuration configuration{values, base};
    TrainOptions& options = configuration.options;
    options.eval = true;
    set_folder(options, std::filesystem::path(base.model) / folder_name(axes, values));
    double share = 1;
    for (std::size_t a = 0; a < axes.size(); ++a) {
        if (axes[a].name == kBudget)
            share = parse_share(values[a]);
        else if (axes[a].name == kPrecision)
            apply_precision(options, values[a]);
        else
            set_option(options, *find_option(axes[a].name), {values[a]}, "--axes " + axes[a].name);
    }
    require_named_appearance(options);
    options = resolve(options);
    const bool varies_iterations =
        std::any_of(axes.begin(), axes.end(), [](const TradeoffAxis& axis) { return axis.name == "iterations"; });
    if (varies_iterations && options.time_limit)
        throw UsageError(
            "--axes iterations: with --time-limit the time decides how many there are; leave one of the two out");
    limit_budget(options, share);  // share of --cap-max, which another axis may have set
    return configuration;
}

std::vector<Configuration> spread_grid(const std::vector<TradeoffAxis>& axes, const TrainOptions& base) {
    std::size_t count = 1;
    for (const TradeoffAxis& axis : axes) {
        count *= axis.values.size();
        if (count > kMaxConfigurations)
            throw UsageError(fmt::format("--axes: more than {} configurations; name fewer values", kMaxConfigurations));
    }
    if (count < 2)
        throw UsageError(
            "--axes: that is one configuration only; a trade-off needs an axis with two values or more, e.g. --axes "
            "budget=0.1,1");
    std::vector<Configuration> list;
    for (std::size_t k = 0; k < count; ++k) {
        std::vector<std::string> values(axes.size());
        std::size_t rest = k;
        for (std::size_t a = axes.size(); a-- > 0; rest /= axes[a].values.size())
            values[a] = axes[a].values[rest % axes[a].values.size()];
        list.push_back(make_configuration(axes, values, base));
    }
    std::map<std::map<std::string, std::string>, std::size_t> seen;
    for (std::size_t k = 0; k < count; ++k) {
        const auto [same, is_new] = seen.emplace(training_options(list[k].options), k);
        if (!is_new)
            throw UsageError(fmt::format("--axes: '{}' and '{}' are the same training",
                                         configuration_name(axes, list[same->second]),
                                         configuration_name(axes, list[k])));
    }
    spread(axes, list);
    return list;
}

std::string configuration_name(const std::vector<TradeoffAxis>& axes, const Configuration& configuration) {
    std::vector<std::string> parts;
    for (std::size_t a = 0; a < axes.size(); ++a) parts.push_back(axes[a].name + " " + configuration.values[a]);
    return fmt::format("{}", fmt::join(parts, ", "));
}

}  // namespace gs
