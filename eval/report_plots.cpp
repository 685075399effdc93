// SPDX-License-Identifier: Apache-2.0
// Scatter plots as inline SVG.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "eval/escape.h"
#include "eval/report.h"

namespace gs {
namespace {

constexpr double kWidth = 460, kHeight = 300, kLeft = 56, kRight = 16, kTop = 16, kBottom = 48;  // px
constexpr double kLabelHeight = 14, kLabelReach = 110;  ///< labels closer than this overlap

struct Point {
    double x, y, deviation;
    std::string label;
};

struct Axis {
    double low, high, step;
};

/// Round limits around the values, with about five steps.
Axis axis_around(double low, double high) {
    if (high - low < 1e-9 * std::max(1.0, std::abs(high))) low -= 0.5, high += 0.5;
    const double raw = (high - low) / 4, magnitude = std::pow(10, std::floor(std::log10(raw)));
    double step = 10 * magnitude;
    for (const double factor : {5.0, 2.0, 1.0})
        if (raw <= factor * magnitude) step = factor * magnitude;
    return {std::floor(low / step) * step, std::ceil(high / step) * step, step};
}

std::string svg(const std::string& title, const std::string& x_title, const std::vector<Point>& points) {
    double low_x = points[0].x, high_x = low_x, low_y = points[0].y, high_y = low_y;
    for (const Point& p : points) {
        low_x = std::min(low_x, p.x), high_x = std::max(high_x, p.x);
        low_y = std::min(low_y, p.y - p.deviation), high_y = std::max(high_y, p.y + p.deviation);
    }
    const Axis ax = axis_around(low_x, high_x), ay = axis_around(low_y, high_y);
    const double right = kWidth - kRight, bottom = kHeight - kBottom;
    const auto px = [&](double x) { return kLeft + (x - ax.low) / (ax.high - ax.low) * (right - kLeft); };
    const auto py = [&](double y) { return bottom - (y - ay.low) / (ay.high - ay.low) * (bottom - kTop); };
    std::string out = fmt::format("<figure>\n<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">\n", kWidth, kHeight, html_escaped(title));
    // Half a step of slack: sums of steps are not exact.
    for (double x = ax.low; x < ax.high + ax.step / 2; x += ax.step) {
        out += fmt::format("<line class=\"grid\" x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1}\" y2=\"{2}\"/>", px(x), kTop, bottom);
        out += fmt::format("<text x=\"{:.1f}\" y=\"{}\" text-anchor=\"middle\">{:.6g}</text>\n", px(x), bottom + 16, x);
    }
    for (double y = ay.low; y < ay.high + ay.step / 2; y += ay.step) {
        out += fmt::format("<line class=\"grid\" x1=\"{0}\" x2=\"{1}\" y1=\"{2:.1f}\" y2=\"{2:.1f}\"/>", kLeft, right, py(y));
        out += fmt::format("<text x=\"{}\" y=\"{:.1f}\" text-anchor=\"end\">{:.6g}</text>\n", kLeft - 6, py(y) + 4, y);
    }
    out += fmt::format("<text x=\"{:.1f}\" y=\"{}\" text-anchor=\"middle\">{}</text>", (kLeft + right) / 2, kHeight - 10, html_escaped(x_title));
    out += fmt::format("<text transform=\"translate(14 {:.1f}) rotate(-90)\" text-anchor=\"middle\">PSNR, dB</text>\n", (kTop + bottom) / 2);
    std::vector<std::pair<double, double>> labels;  // where they stand so far
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Point& p = points[i];
        const double x = px(p.x), y = py(p.y);
        const std::string full = html_escaped(fmt::format("{}: {:.6g}, {:.2f} dB", p.label, p.x, p.y));
        out += fmt::format("<g class=\"series{}\"><title>{}</title>", i % 8, full);
        if (p.deviation > 0) out += fmt::format("<line class=\"bar\" x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1:.1f}\" y2=\"{2:.1f}\"/>", x, py(p.y + p.deviation), py(p.y - p.deviation));
        out += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"5\"/>", x, y);
        double label_y = y + 4;
        const auto taken = [&](const auto& other) { return std::abs(other.first - x) < kLabelReach && std::abs(other.second - label_y) < kLabelHeight; };
        while (std::any_of(labels.begin(), labels.end(), taken)) label_y += kLabelHeight;
        labels.emplace_back(x, label_y);
        const bool left = x > (kLeft + right) / 2;
        out += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\">{}</text></g>\n", x + (left ? -9 : 9), label_y, left ? "end" : "start", html_escaped(p.label));
    }
    return out + fmt::format("</svg>\n<figcaption>{}</figcaption>\n</figure>\n", html_escaped(title));
}

struct Cost {
    const char *key, *title, *axis;
};
constexpr Cost kCosts[] = {{"train_seconds", "training time", "training time, s"}, {"bytes_per_gaussian", "appearance size", "appearance, bytes a Gaussian"}};

}  // namespace

std::string report_plots(const Comparison& comparison) {
    std::string out;
    for (const ComparisonTable& table : comparison.tables) {
        for (const Cost& cost : kCosts) {
            const auto column = std::find_if(comparison.columns.begin(), comparison.columns.end(), [&](const Column& c) { return c.key == cost.key; });
            const std::size_t k = std::size_t(column - comparison.columns.begin());
            std::vector<Point> points;
            for (const ComparisonLine& line : table.lines) {
                const auto &psnr = line.values[0], &x = line.values[k];
                if (!psnr || !x || !std::isfinite(psnr->mean) || line.num_scenes != table.num_scenes) continue;
                const std::string name = line.model.empty() ? line.label : line.model;
                points.push_back({x->mean, psnr->mean, psnr->deviation.value_or(0), line.options.empty() ? name : name + ", " + line.options});
            }
            if (points.empty()) continue;
            out += svg(fmt::format("{}: PSNR over {}", table.scene.empty() ? table.dataset : table.scene, cost.title), cost.axis, points);
        }
    }
    return out;
}

}  // namespace gs
