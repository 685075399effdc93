// SPDX-License-Identifier: Apache-2.0
// Draws a scatter plot as inline SVG, using the CSS classes of the page.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// A point, its label and its appearance.
struct ScatterPoint {
    double x = 0, y = 0;
    double deviation = 0;    ///< half the length of an error bar along y; 0 = none
    std::string label = {};  ///< text beside the point
    std::string tooltip = {};
    int series = 0;     ///< index of its colour
    bool ring = false;  ///< draws a ring around the point to highlight it
    bool grey = false;  ///< draws the point small and without colour
};

/// The points, axes and options of a plot.
struct ScatterPlot {
    std::string title, x_title, y_title;
    bool log_x = false;  ///< logarithmic x axis; all x must then be positive
    /// Draws a line through the Pareto front: the points for which no other has smaller x and larger y. Only these and
    /// points with rings are labelled then.
    bool connect_front = false;
    std::vector<ScatterPoint> points;  ///< at least one point; coordinates must be finite
};

/// Returns the plot as a <figure> with a caption.
std::string scatter_svg(const ScatterPlot& plot);

}  // namespace gs
