// SPDX-License-Identifier: Apache-2.0
// Draws axes, marks, labels and a legend as SVG elements.
#include "eval/pages/scatter.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "eval/pages/escape.h"

namespace gs {
namespace {

constexpr double kWidth = 460, kHeight = 300, kLeft = 56, kRight = 16, kTop = 16, kBottom = 48;  // px
constexpr double kRightEnd = kWidth - kRight, kBottomEnd = kHeight - kBottom;
constexpr double kLabelHeight = 13, kLetterWidth = 7, kLabelGap = 10;  // px, estimated for text of 12 px

struct Axis {
    std::vector<double> ticks;  ///< ascending; the first and the last are the ends of the axis
    bool log = false;

    /// Returns the position of v on the axis: 0 at the first tick, 1 at the last.
    double place(double v) const {
        const auto f = [&](double x) { return log ? std::log(x) : x; };
        return (f(v) - f(ticks.front())) / (f(ticks.back()) - f(ticks.front()));
    }
};

/// Returns an axis with round limits around the values and about five steps.
Axis linear_axis(double low, double high) {
    if (high - low < 1e-9 * std::max(1.0, std::abs(high))) low -= 0.5, high += 0.5;
    const double raw = (high - low) / 4, magnitude = std::pow(10, std::floor(std::log10(raw)));
    double step = 10 * magnitude;
    for (const double factor : {5.0, 2.0, 1.0})
        if (raw <= factor * magnitude) step = factor * magnitude;
    Axis axis;
    for (double k = std::floor(low / step); k <= std::ceil(high / step); ++k) axis.ticks.push_back(k * step);
    return axis;
}

/// Returns an axis with ticks at 1, 2, 5, 10, ...
Axis log_axis(double low, double high) {
    Axis axis{{}, true};
    for (double decade = std::pow(10, std::floor(std::log10(low)));; decade *= 10) {
        for (const double factor : {1.0, 2.0, 5.0}) {
            const double tick = factor * decade;
            if (tick <= low) axis.ticks.clear();  // the axis starts later
            axis.ticks.push_back(tick);
            if (tick >= high && axis.ticks.size() > 1) return axis;
        }
    }
}

struct Box {
    double x, y, width, height;
};

bool overlap(const Box& a, const Box& b) {
    return a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
}

std::string text(double x, double y, const char* anchor, const std::string& content) {
    return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\">{}</text>", x, y, anchor,
                       html_escaped(content));
}

std::string line(const char* style, double x1, double y1, double x2, double y2) {
    return fmt::format("<line class=\"{}\" x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"{:.1f}\" y2=\"{:.1f}\"/>", style, x1, x2,
                       y1, y2);
}

class Drawing {
  public:
    explicit Drawing(const ScatterPlot& plot) : plot_(plot) {
        double low_x = plot.points[0].x, high_x = low_x, low_y = plot.points[0].y, high_y = low_y;
        for (const ScatterPoint& p : plot.points) {
            low_x = std::min(low_x, p.x), high_x = std::max(high_x, p.x);
            low_y = std::min(low_y, p.y - p.deviation), high_y = std::max(high_y, p.y + p.deviation);
        }
        x_ = plot.log_x ? log_axis(low_x, high_x) : linear_axis(low_x, high_x);
        y_ = linear_axis(low_y, high_y);
    }

    std::string draw() {
        std::string out = fmt::format("<figure>\n<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">\n", kWidth,
                                      kHeight, html_escaped(plot_.title));
        const auto tick = [](double v) { return fmt::format("{:.6g}", v); };
        for (const double x : x_.ticks)
            out +=
                line("grid", px(x), kTop, px(x), kBottomEnd) + text(px(x), kBottomEnd + 16, "middle", tick(x)) + "\n";
        for (const double y : y_.ticks)
            out += line("grid", kLeft, py(y), kRightEnd, py(y)) + text(kLeft - 6, py(y) + 4, "end", tick(y)) + "\n";
        out += text((kLeft + kRightEnd) / 2, kHeight - 10, "middle", plot_.x_title);
        out += fmt::format("<text transform=\"translate(14 {:.1f}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
                           (kTop + kBottomEnd) / 2, html_escaped(plot_.y_title));
        std::vector<const ScatterPoint*> order = front();
        if (plot_.connect_front) out += connected(order);
        for (const bool grey : {true, false})  // draws coloured points on top
            for (const ScatterPoint& p : plot_.points)
                if (p.grey == grey) out += point(p);
        // Places the labels of the front first.
        for (const ScatterPoint& p : plot_.points)
            if ((p.ring || !plot_.connect_front) && std::find(order.begin(), order.end(), &p) == order.end())
                order.push_back(&p);
        for (const ScatterPoint* p : order)
            if (!p->label.empty()) out += label(*p);
        return out + fmt::format("</svg>\n<figcaption>{}</figcaption>\n</figure>\n", html_escaped(plot_.title));
    }

  private:
    double px(double x) const { return kLeft + x_.place(x) * (kRightEnd - kLeft); }
    double py(double y) const { return kBottomEnd - y_.place(y) * (kBottomEnd - kTop); }

    /// Returns the points for which no other has smaller x and larger y, from left to right.
    std::vector<const ScatterPoint*> front() const {
        std::vector<const ScatterPoint*> order, front;
        for (const ScatterPoint& p : plot_.points) order.push_back(&p);
        std::sort(order.begin(), order.end(),
                  [](const auto* a, const auto* b) { return a->x != b->x ? a->x < b->x : a->y > b->y; });
        for (const ScatterPoint* p : order)
            if (front.empty() || p->y > front.back()->y) front.push_back(p);
        return front;
    }

    std::string connected(const std::vector<const ScatterPoint*>& points) const {
        std::string corners;
        for (const ScatterPoint* p : points) corners += fmt::format("{:.1f},{:.1f} ", px(p->x), py(p->y));
        return fmt::format("<polyline class=\"front\" points=\"{}\"/>\n", corners);
    }

    static std::string style_of(const ScatterPoint& p) {
        return p.grey ? "dominated" : fmt::format("series{}", p.series % 8);
    }

    std::string point(const ScatterPoint& p) const {
        const double x = px(p.x), y = py(p.y);
        std::string out = fmt::format("<g class=\"{}\"><title>{}</title>", style_of(p), html_escaped(p.tooltip));
        if (p.deviation > 0) out += line("bar", x, py(p.y + p.deviation), x, py(p.y - p.deviation));
        if (p.ring) out += fmt::format("<circle class=\"ring\" cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"8\"/>", x, y);
        return out + fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{}\"/></g>\n", x, y, p.grey ? 3.5 : 5);
    }

    /// Draws the label beside, above or below the point if there is room, else further down.
    std::string label(const ScatterPoint& p) {
        const double x = px(p.x), y = py(p.y), width = kLetterWidth * double(p.label.size());
        const auto box_at = [&](bool left, double dy) {
            return Box{left ? x - kLabelGap - width : x + kLabelGap, y + dy - kLabelHeight / 2, width, kLabelHeight};
        };
        const bool left_first = x > (kLeft + kRightEnd) / 2;
        for (const double dy : {0.0, -kLabelHeight, kLabelHeight}) {
            for (const bool left : {left_first, !left_first}) {
                const Box box = box_at(left, dy);
                if (box.x >= kLeft && box.x + width <= kWidth && is_free(box)) return placed(p, box, left);
            }
        }
        Box box = box_at(left_first, 0);
        while (!is_free(box)) box.y += kLabelHeight;
        return placed(p, box, left_first);
    }

    bool is_free(const Box& box) const {
        return std::none_of(labels_.begin(), labels_.end(), [&](const Box& other) { return overlap(box, other); }) &&
               std::none_of(plot_.points.begin(), plot_.points.end(), [&](const ScatterPoint& p) {
                   return overlap(box, {px(p.x) - 4, py(p.y) - 4, 8, 8});
               });
    }

    /// Draws the label in `box`, with a line to its point unless it is right beside it.
    std::string placed(const ScatterPoint& p, const Box& box, bool left) {
        labels_.push_back(box);
        const double x = left ? box.x + box.width : box.x, middle = box.y + kLabelHeight / 2;
        const bool beside = std::abs(middle - py(p.y)) < 1;
        return fmt::format("<g class=\"{}\">{}{}</g>\n", style_of(p),
                           beside ? "" : line("leader", px(p.x), py(p.y), x, middle),
                           text(x, middle + 4, left ? "end" : "start", p.label));
    }

    const ScatterPlot& plot_;
    Axis x_, y_;
    std::vector<Box> labels_;  ///< areas of the labels drawn so far
};

}  // namespace

std::string scatter_svg(const ScatterPlot& plot) { return Drawing(plot).draw(); }

}  // namespace gs
