// SPDX-License-Identifier: Apache-2.0
// Plans the rounds of a grid and of successive halving, and detects before the first run everything that would make
// runs fail or a budget useless.
#include "eval/experiments/tradeoff_plan.h"

#include <fmt/format.h>

#include <algorithm>

#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/scene/scene.h"

namespace gs {
namespace {

/// Divisors of --iterations, one per round.
constexpr std::int64_t kDivisors[] = {4, 2, 1};

double default_give_up(Quality quality) { return quality == Quality::kPsnr ? 1.0 : 0.02; }

void require_free_folders(const Rounds& rounds) {
    for (const auto& round : rounds)
        for (const Configuration& configuration : round)
            if (const std::string difference = difference_to_run(configuration.options); !difference.empty())
                throw UsageError(
                    fmt::format("{} holds a run of other options ({}); choose another -m FOLDER, or give --overwrite",
                                configuration.options.model, difference));
}

/// Throws UsageError if a folder holds a run of a different scene than `scene`, whose files may have changed since.
void require_same_scene(const Rounds& rounds, const Scene& scene) {
    for (const auto& round : rounds)
        for (const Configuration& configuration : round) {
            const TrainOptions& options = configuration.options;
            if (const std::string difference = difference_to_scene(options.model, options, scene); !difference.empty())
                throw UsageError(
                    fmt::format("{}: {} has changed since the run there was trained: {}; choose another -m "
                                "FOLDER, or give --overwrite",
                                options.model, options.source, difference));
        }
}

/// Returns a remark with the number of configurations whose --cap-max is below the scene's `points`; empty if none is.
std::string remark_on_budgets(const std::vector<Configuration>& round, std::int64_t points) {
    const auto below =
        std::count_if(round.begin(), round.end(), [&](const Configuration& c) { return c.options.cap_max < points; });
    if (below == 0) return "";
    return fmt::format(
        "{} of {} configurations have a --cap-max below the {} points that the scene begins with; training keeps "
        "these, "
        "so that they do not become smaller. A higher --cap-max makes the budget a limit.",
        below, round.size(), points);
}

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

TradeoffPlan plan_tradeoff(TrainOptions base, const TradeoffRequest& request) {
    if (!base.resume.empty())
        throw UsageError("tradeoff: runs are not resumed; the same command again trains those that are missing");
    if (base.model.empty())
        base.model = (std::filesystem::path("output") / (scene_name(base.source) + "-tradeoff")).string();
    apply_preset(base);  // default axis values depend on the iterations
    TradeoffPlan plan{base.model, {}, {}};
    plan.tradeoff.source = base.source;
    plan.tradeoff.quality = request.quality;
    plan.tradeoff.give_up = request.give_up.value_or(default_give_up(request.quality));
    plan.rounds =
        (request.search == SearchKind::kGrid ? plan_grid : plan_halving)(request.axes, base, plan.tradeoff.axes);
    if (!base.overwrite) require_free_folders(plan.rounds);
    const Scene scene = load_scene(plan.rounds[0][0].options);
    if (!base.overwrite) require_same_scene(plan.rounds, scene);
    if (scene.test.empty())
        throw DataError(
            fmt::format("{}: there are no test views to measure quality on ({})", scene.source, scene.split_rule));
    if (std::string remark = remark_on_budgets(plan.rounds[0], std::int64_t(scene.points.positions.size()));
        !remark.empty())
        plan.tradeoff.remarks.push_back(std::move(remark));
    return plan;
}

}  // namespace gs
