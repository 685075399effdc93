// SPDX-License-Identifier: Apache-2.0
// Depths as colours, and the range that they share.
#include "apps/gsapp/render/false_colors.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"

namespace gs {
namespace {

TEST(DepthColors, RangeLeavesOutWhatFloats) {
    DepthRangeFinder finder;
    EXPECT_EQ(finder.range().far, 0);
    std::vector<float> depth(1000), alpha(1000, 1.0f);
    for (int i = 0; i < 1000; ++i) depth[std::size_t(i)] = 2 + 0.001f * float(i);
    depth[3] = 0.2f, depth[4] = 900;
    depth[5] = 50, alpha[5] = 0.4f;  // hardly there
    finder.add(depth, alpha);
    EXPECT_NEAR(finder.range().near, 2.01, 0.005);
    EXPECT_NEAR(finder.range().far, 2.99, 0.005);
    finder.add({7}, {1});
    EXPECT_EQ(finder.range().far, 7) << "the range is that of all pictures";
    EXPECT_NEAR(finder.range().near, 2.01, 0.005);
    finder.add({0, 0.1f}, {0, 0.2f});
    EXPECT_EQ(finder.range().far, 7);
}

TEST(DepthColors, GoFromYellowToPurple) {
    const std::vector<float> depth = {0, 1, 2, 3, 0.5f, 9};
    const Image image = colored_depth(depth, 3, 2, {1, 3});
    const auto pixel = [&](int x, int y) {
        const std::uint8_t* p = &image.u8[std::size_t(3 * (3 * y + x))];
        return std::array<int, 3>{p[0], p[1], p[2]};
    };
    using Color = std::array<int, 3>;
    EXPECT_EQ(pixel(0, 0), (Color{0, 0, 0}));
    EXPECT_EQ(pixel(1, 0), (Color{253, 231, 37}));
    EXPECT_EQ(pixel(2, 0), (Color{33, 144, 140})) << "halfway";
    EXPECT_EQ(pixel(0, 1), (Color{68, 1, 84}));
    EXPECT_EQ(pixel(1, 1), pixel(1, 0)) << "nearer than near";
    EXPECT_EQ(pixel(2, 1), pixel(0, 1));
    // One depth alone, and no range at all.
    EXPECT_EQ(colored_depth({2}, 1, 1, {2, 2}).u8.size(), 3u);
    EXPECT_EQ(colored_depth({0}, 1, 1, {}).u8, (std::vector<std::uint8_t>{0, 0, 0}));
}

TEST(DepthColors, RangeIsStatedInJson) {
    const auto json = parse_json(depth_range_text({1.5, 20}, DepthKind::kExpected));
    EXPECT_EQ(json["near"], 1.5);
    EXPECT_EQ(json["far"], 20);
    EXPECT_NE(json["values"].get<std::string>().find("expected"), std::string::npos);
    const auto median = parse_json(depth_range_text({1.5, 20}, DepthKind::kMedian));
    EXPECT_NE(median["values"].get<std::string>().find("median"), std::string::npos);
}

}  // namespace
}  // namespace gs
