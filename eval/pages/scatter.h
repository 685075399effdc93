// SPDX-License-Identifier: Apache-2.0
// A scatter plot as inline SVG, in the classes of the page's style.
#pragma once

#include <string>
#include <vector>

namespace gs {

struct ScatterPoint {
    double x = 0, y = 0;
    double deviation = 0;  ///< of y, as a bar; 0: none
    std::string label = {};  ///< beside the point
    std::string tooltip = {};
    int series = 0;        ///< its colour
    bool ring = false;     ///< around the point, to point it out
    bool grey = false;     ///< small and without colour
};

struct ScatterPlot {
    std::string title, x_title, y_title;
    bool log_x = false;          ///< all x must then be positive
    bool connect_front = false;  ///< a line through the points that have no other with less x and more y; only these and those with rings have labels
    std::vector<ScatterPoint> points;  ///< finite; at least one
};

std::string scatter_svg(const ScatterPlot& plot);

}  // namespace gs
