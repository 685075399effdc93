// SPDX-License-Identifier: Apache-2.0
// Chooses and fills the plots of the page.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "eval/pages/scatter.h"
#include "eval/report/report.h"

namespace gs {
namespace {

struct Cost {
    const char *key, *title, *axis;
};
constexpr Cost kCosts[] = {{"train_seconds", "training time", "training time, s"},
                           {"bytes_per_gaussian", "appearance size", "appearance, bytes a Gaussian"}};

}  // namespace

std::string report_plots(const Comparison& comparison) {
    std::string out;
    for (const ComparisonTable& table : comparison.tables) {
        for (const Cost& cost : kCosts) {
            const auto column = std::find_if(comparison.columns.begin(), comparison.columns.end(),
                                             [&](const Column& c) { return c.key == cost.key; });
            const std::size_t k = std::size_t(column - comparison.columns.begin());
            ScatterPlot plot;
            for (const ComparisonLine& line : table.lines) {
                const auto &psnr = line.values[0], &x = line.values[k];
                if (!psnr || !x || !std::isfinite(psnr->mean) || line.num_scenes != table.num_scenes) continue;
                const std::string name = line.model.empty() ? line.label : line.model;
                const std::string label = line.options.empty() ? name : name + ", " + line.options;
                plot.points.push_back({.x = x->mean,
                                       .y = psnr->mean,
                                       .deviation = psnr->deviation.value_or(0),
                                       .label = label,
                                       .tooltip = fmt::format("{}: {:.6g}, {:.2f} dB", label, x->mean, psnr->mean),
                                       .series = int(plot.points.size())});
            }
            if (plot.points.empty()) continue;
            plot.title = fmt::format("{}: PSNR over {}", table.scene.empty() ? table.dataset : table.scene, cost.title);
            plot.x_title = cost.axis, plot.y_title = "PSNR, dB";
            out += scatter_svg(plot);
        }
    }
    return out;
}

}  // namespace gs
