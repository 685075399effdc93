// SPDX-License-Identifier: Apache-2.0
// Sixteen Gaussians at a time against one, and the lanes' functions against those of the standard library.
#include "kernels/preprocess/splat_lanes_cpu.h"

#include <gtest/gtest.h>
#include <cmath>
#include <limits>

#include "kernels/preprocess/gaussian_device.h"
#include "kernels/ranks/shard.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();
constexpr int kTilesX = 7, kTilesY = 5;

/// Returns n > 308 Gaussians in and out of view, some of them with one value that no Gaussian should have.
template <class Real> GaussianState<Real> awkward_gaussians(std::int64_t n, bool with_filter = false) {
    auto s = random_gaussians(n, 0, 77);
    for (double& x : s[Group::kMean].param) x *= 4;
    const double extremes[] = {kNan, kInfinity, -kInfinity, 1e30, -1e30, 0, 1e-30};
    int k = 0;
    for (const Group group : {Group::kMean, Group::kScale, Group::kRotation, Group::kOpacity})
        for (const double extreme : extremes) s[group].param[std::size_t(11 * ++k)] = extreme;
    for (int c = 0; c < 4; ++c) s[Group::kRotation].param[4 * 7 + c] = 0;
    return cast<Real>(with_filter ? antialiased(s) : s);
}

/// Compares to `tolerance`, relative to what the rounding of each value grows with.
template <class Real> void expect_lanes_equal_scalars(double tolerance, bool with_filter) {
    const auto s = awkward_gaussians<Real>(1003, with_filter);
    const auto camera = cast<Real>(test_camera(kTilesX * kCpuTile - 3, kTilesY * kCpuTile - 9));
    const int width = kTilesX * kCpuTile, height = kTilesY * kCpuTile;
    const Cutoffs<Real> cutoffs;
    const auto params = ParameterView<Real>::of(s);
    const auto view = ViewLanes<Real>::of(camera, width, height, cutoffs);
    int shown = 0, culled = 0;
    for (std::int64_t first = 0; first < s.count; first += kLanes) {
        SplatLanes<Real> lanes;
        const unsigned mask = make_splats(params, first, view, lanes);
        for (int lane = 0; lane < kLanes; ++lane) {
            const std::int64_t i = first + lane;
            const bool has = mask >> lane & 1;
            if (i >= s.count) {
                EXPECT_FALSE(has) << "beyond the last row";
                continue;
            }
            Splat<Real> e{};
            PixelBounds bounds{};
            Real depth{};
            ASSERT_EQ(make_splat(params.geometry(i), camera, width, height, e, bounds, depth, cutoffs,
                                 static_cast<LensShape<Real>*>(nullptr)),
                      has)
                << i;
            ++(has ? shown : culled);
            if (!has) continue;
            const Splat<Real> a = lanes.splat(lane);
            const auto near = [&](Real x, Real y, double scale) { EXPECT_NEAR(x, y, tolerance * scale) << i; };
            near(a.mean.x, e.mean.x, 1e3), near(a.mean.y, e.mean.y, 1e3);
            // The determinant cancels, the more the longer the ellipse is.
            const double size = std::abs(e.a) + std::abs(e.c), stretch = 1 + size * size / (e.a * e.c - e.b * e.b);
            near(a.a, e.a, size * stretch), near(a.b, e.b, size * stretch), near(a.c, e.c, size * stretch);
            near(a.opacity, e.opacity, 1), near(a.threshold, e.threshold, 10);
            near(lanes.depth[lane], depth, std::abs(depth));
            const PixelBounds b = lanes.pixel_bounds(lane);
            EXPECT_LE(std::abs(b.x_min - bounds.x_min) + std::abs(b.x_max - bounds.x_max) +
                          std::abs(b.y_min - bounds.y_min) + std::abs(b.y_max - bounds.y_max),
                      1)
                << i;
        }
    }
    EXPECT_GT(shown, 100);
    EXPECT_GT(culled, 100);
}

TEST(SplatLanes, EqualOneGaussianAtATime) {
    for (const bool with_filter : {false, true}) {
        expect_lanes_equal_scalars<double>(1e-14, with_filter);
        expect_lanes_equal_scalars<float>(2e-6, with_filter);
    }
}

TEST(SplatLanes, DoNotDependOnTheirNeighbours) {
    const auto s = awkward_gaussians<float>(320);
    const auto camera = cast<float>(test_camera(100, 70));
    const auto view = ViewLanes<float>::of(camera, 112, 80, {});
    const auto params = ParameterView<float>::of(s);
    for (std::int64_t first = 0; first < s.count - kLanes; first += 3) {
        SplatLanes<float> together, alone;
        const unsigned mask = make_splats(params, first, view, together);
        for (int lane = 0; lane < kLanes; ++lane) {
            auto last = params;
            last.count = first + lane + 1;
            ASSERT_EQ(make_splats(last, first + lane, view, alone), mask >> lane & 1) << first + lane;
            if (!(mask >> lane & 1)) continue;
            const Splat<float> a = together.splat(lane), b = alone.splat(0);
            EXPECT_EQ(std::memcmp(&a, &b, sizeof a), 0) << first + lane;
        }
    }
}

/// Returns the tiles by the test of one tile at a time; `slack` widens the threshold.
template <class Real>
std::vector<std::uint32_t> tiles_one_by_one(const Splat<Real>& s, const PixelBounds& b, int tiles_x, Real slack) {
    std::vector<std::uint32_t> tiles;
    for (int y = b.y_min / kCpuTile; y * kCpuTile < b.y_max; ++y)
        for (int x = b.x_min / kCpuTile; x * kCpuTile < b.x_max; ++x)
            if (min_power_in_rectangle(s, Real(x * kCpuTile), Real(y * kCpuTile), Real(kCpuTile - 1),
                                       Real(kCpuTile - 1)) <= touch_threshold(s) + slack)
                tiles.push_back(std::uint32_t(y) * tiles_x + x);
    return tiles;
}

TEST(SplatLanes, TilesAreThoseOfOneTileAtATime) {
    constexpr int kX = 13, kY = 11;  // no multiples of the four tiles that are tested at once
    std::mt19937 rng(5);
    std::uniform_real_distribution<float> unit(0, 1);
    int single = 0, several = 0;
    for (int k = 0; k < 20000; ++k) {
        // Ellipses of 0.3 to 60 pixels in every direction, around means within and beyond the image.
        const float r0 = 0.3f * std::pow(200.0f, unit(rng)), r1 = 0.3f * std::pow(200.0f, unit(rng)),
                    angle = 6.3f * unit(rng), c = std::cos(angle), n = std::sin(angle), v0 = r0 * r0 + 0.3f,
                    v1 = r1 * r1 + 0.3f;
        Splat<float> s{};
        s.mean = {(1.2f * unit(rng) - 0.1f) * kX * kCpuTile, (1.2f * unit(rng) - 0.1f) * kY * kCpuTile};
        s.a = c * c / v0 + n * n / v1, s.b = c * n * (1 / v0 - 1 / v1), s.c = n * n / v0 + c * c / v1;
        s.opacity = 0.01f + 0.99f * unit(rng);
        s.threshold = splat_threshold(s.opacity, 255.0f);
        const PixelBounds b = pixel_bounds(s.mean, {c * c * v0 + n * n * v1, 0, n * n * v0 + c * c * v1},
                                           touch_threshold(s), kX * kCpuTile, kY * kCpuTile);
        if (b.x_max <= b.x_min || b.y_max <= b.y_min) continue;
        std::vector<std::uint32_t> tiles{12345};  // those of an earlier Gaussian stay
        const std::uint32_t added = add_tiles(s, b, kX, tiles);
        ASSERT_EQ(added, tiles.size() - 1);
        EXPECT_EQ(tiles[0], 12345u);
        tiles.erase(tiles.begin());
        std::sort(tiles.begin(), tiles.end());
        // Tiles within rounding of the threshold may be on either side.
        const auto surely = tiles_one_by_one(s, b, kX, -5e-4f), perhaps = tiles_one_by_one(s, b, kX, 5e-4f);
        ASSERT_TRUE(std::includes(tiles.begin(), tiles.end(), surely.begin(), surely.end())) << k;
        ASSERT_TRUE(std::includes(perhaps.begin(), perhaps.end(), tiles.begin(), tiles.end())) << k;
        single += tiles.size() == 1, several += tiles.size() > 16;
    }
    EXPECT_GT(single, 1000);
    EXPECT_GT(several, 1000);
}

/// Returns the value of a function of lanes in each lane.
template <class Fn> float in_lanes(Fn fn, float x) { return fn(Lanes<float>(x))[kLanes - 1]; }

TEST(LaneFunctions, ExponentialAndLogarithm) {
    const auto exponential = [](const Lanes<float>& x) { return gs_exp(x); };
    const auto logarithm = [](const Lanes<float>& x) { return gs_log(x); };
    double worst_exp = 0, worst_log = 0;
    for (int k = -86990; k <= 87990; k += 7) {
        const float x = float(k) * 1e-3f, y = std::exp(x);
        worst_exp = std::max(worst_exp, std::abs(in_lanes(exponential, x) / std::exp(double(x)) - 1));
        const double exact = std::log(double(y));
        worst_log = std::max(worst_log, std::abs(in_lanes(logarithm, y) - exact) / (1 + std::abs(exact)));
    }
    for (int k = 1; k < 40000; ++k) {  // around 1, where the logarithm is small
        const float x = float(k) * 1e-4f;
        const double exact = std::log(double(x));
        worst_log = std::max(worst_log, std::abs(in_lanes(logarithm, x) - exact) / (1 + std::abs(exact)));
    }
    EXPECT_LT(worst_exp, 2e-7);
    EXPECT_LT(worst_log, 2e-7);
    std::printf("exp: relative error %.2e; log: %.2e\n", worst_exp, worst_log);
    EXPECT_EQ(in_lanes(logarithm, 1.0f), 0.0f);
    EXPECT_EQ(in_lanes(exponential, 0.0f), 1.0f);
    EXPECT_TRUE(std::isnan(in_lanes(exponential, kNan)));
    EXPECT_EQ(in_lanes(exponential, kInfinity), in_lanes(exponential, 88.0f));
    EXPECT_EQ(in_lanes(exponential, -kInfinity), in_lanes(exponential, -87.0f));
}

TEST(LaneFunctions, RoundAndTakeRootsAsScalarsDo) {
    for (const float x : {-2.5f, -1.0f, -0.0f, 0.49f, 7.0f, 1e10f, kInfinity}) {
        EXPECT_EQ(in_lanes([](const Lanes<float>& v) { return gs_floor(v); }, x), std::floor(x));
        EXPECT_EQ(in_lanes([](const Lanes<float>& v) { return gs_ceil(v); }, x), std::ceil(x));
        if (x >= 0) {
            EXPECT_EQ(in_lanes([](const Lanes<float>& v) { return gs_sqrt(v); }, x), std::sqrt(x));
        }
    }
    const Lanes<float> nan(kNan), one(1.0f);
    EXPECT_EQ(gs_max(nan, one)[0], 1.0f);
    EXPECT_TRUE(std::isnan(gs_max(one, nan)[0]));
    EXPECT_EQ(gs_min(nan, one)[0], 1.0f);
    EXPECT_TRUE(std::isnan(gs_min(one, nan)[0]));
}

std::uint64_t share(double of_all) { return SplatRooms::share(std::uint64_t(of_all * 1000), 1000); }

TEST(SplatRooms, HoldWhatTheViewHadAndALittleMore) {
    SplatRooms rooms;
    rooms.note({3}, share(0.5));
    EXPECT_GE(rooms.room({3}, 1000), 562u) << "an eighth";
    EXPECT_LE(rooms.room({3}, 1000), 579u);
    rooms.note({3}, share(0.1));
    EXPECT_LE(rooms.room({3}, 1000), 129u) << "it follows the training";
}

TEST(SplatRooms, TakeOtherViewsForThoseThatTheyDoNotKnow) {
    SplatRooms rooms;
    EXPECT_LT(rooms.room({0}, 1000000), 300000u);
    rooms.note({7}, share(0.8));
    for (const int view : {-1, 0}) EXPECT_GE(rooms.room({view}, 1000), 800u);
    rooms.note({-1}, share(0.9));
    EXPECT_GE(rooms.room({-1}, 1000), 900u);
    EXPECT_LE(rooms.room({7}, 1000), 917u);
}

TEST(SplatRooms, AreNeverMoreThanThereAreRows) {
    SplatRooms rooms;
    rooms.note({0}, share(1));
    for (const std::int64_t rows : {0, 1, 15, 1000}) EXPECT_EQ(rooms.room({0}, rows), std::size_t(rows));
}

TEST(SplatRooms, HoldAllThatWasNotedInSmallModels) {
    for (std::int64_t rows = 1; rows < 300; ++rows)
        for (std::int64_t shown = 0; shown <= rows; ++shown) {
            SplatRooms rooms;
            rooms.note({0}, SplatRooms::share(std::uint64_t(shown), rows));
            ASSERT_GE(rooms.room({0}, rows), std::size_t(shown)) << rows;
        }
}

TEST(SplatRooms, HoldAllOfTwoThousandMillion) {
    SplatRooms rooms;
    constexpr std::int64_t kMost = 0x7fffffff;
    rooms.note({0}, SplatRooms::share(kMost - 1, kMost));
    EXPECT_EQ(rooms.room({0}, kMost), std::size_t(kMost));
    EXPECT_EQ(SplatRooms::share(0, 0), 0u);
}

}  // namespace
}  // namespace gs::test
