// SPDX-License-Identifier: Apache-2.0
// Draws a scatter plot as inline SVG, in the classes of the page's style.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// One point, its label and its look.
struct ScatterPoint {
    double x = 0, y = 0;
    double deviation = 0;    ///< half the length of a bar along y; 0 = none
    std::string label = {};  ///< text beside the point
    std::string tooltip = {};
    int series = 0;     ///< number of its colour
    bool ring = false;  ///< a ring around the point points it out
    bool grey = false;  ///< the point is small and has no colour
};

/// The points, axes and options of a plot.
struct ScatterPlot {
    std::string title, x_title, y_title;
    bool log_x = false;  ///< logarithmic; all x must then be positive
    /// Draws a line through the points that have no other with less x and more y. Only these and those with rings have
    /// labels then.
    bool connect_front = false;
    std::vector<ScatterPoint> points;  ///< at least one; coordinates are finite
};

/// Returns the plot as a <figure> with a caption.
std::string scatter_svg(const ScatterPlot& plot);

}  // namespace gs
