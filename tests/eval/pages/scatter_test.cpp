// SPDX-License-Identifier: Apache-2.0
// Axes and labels of plots; what the pages plot is tested with them.
#include "eval/pages/scatter.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

std::string plot(std::vector<ScatterPoint> points, bool log_x, bool connect_front = false) {
    return scatter_svg({.title = "t",
                        .x_title = "x",
                        .y_title = "y",
                        .log_x = log_x,
                        .connect_front = connect_front,
                        .points = std::move(points)});
}

bool has_tick(const std::string& svg, const std::string& number) {
    return svg.find("\"middle\">" + number + "</text>") != std::string::npos;
}

TEST(Scatter, LogarithmicAxisEnclosesTheValuesInOneTwoFive) {
    const std::string svg = plot({{.x = 0.3, .y = 1}, {.x = 40, .y = 2}}, true);
    for (const char* tick : {"0.2", "0.5", "1", "2", "5", "10", "20", "50"}) EXPECT_TRUE(has_tick(svg, tick)) << tick;
    for (const char* tick : {"0.1", "100"}) EXPECT_FALSE(has_tick(svg, tick)) << tick;
    const std::string one = plot({{.x = 2, .y = 1}}, true);
    EXPECT_TRUE(has_tick(one, "2") && has_tick(one, "5")) << one;
    EXPECT_EQ(one.find("nan"), std::string::npos);
}

TEST(Scatter, LabelsOfThePlotsFrontOnlyAndOfRings) {
    const std::vector<ScatterPoint> points = {{.x = 1, .y = 1, .label = "first"},
                                              {.x = 2, .y = 0.5, .label = "behind"},
                                              {.x = 3, .y = 0.2, .label = "ringed", .ring = true},
                                              {.x = 4, .y = 3, .label = "last"}};
    const std::string front = plot(points, true, true);
    for (const char* label : {">first<", ">ringed<", ">last<"})
        EXPECT_NE(front.find(label), std::string::npos) << label;
    EXPECT_EQ(front.find(">behind<"), std::string::npos);
    EXPECT_NE(plot(points, true).find(">behind<"), std::string::npos);
}

TEST(Scatter, LabelsWithoutRoomAreLedBackToTheirPoints) {
    EXPECT_EQ(plot({{.x = 1, .y = 1, .label = "alone"}}, false).find("leader"), std::string::npos);
    EXPECT_NE(plot(std::vector<ScatterPoint>(3, {.x = 1, .y = 1, .label = "together"}), false).find("leader"),
              std::string::npos);
}

}  // namespace
}  // namespace gs
