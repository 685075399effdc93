// SPDX-License-Identifier: Apache-2.0
// Spherical Voronoi: golden vectors, invariants, limits of temperature and site length, rates.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "appearance/model_info.h"
#include "appearance/sv/sv.h"

namespace gs {

namespace appearance {
const ModelInfo& sv_info();
}

namespace {

using appearance::Sv;
using Three = appearance::SphericalVoronoi<3>;

const Vec3<double> kMean{1, 2, 3}, kGradient{1, -.5, .25};
const auto kView = view_direction(kMean, Vec3<double>{0, 0, 0});
const std::vector<double> kRows = {1,   .2, .3, .5, .1,  .2,  .3, -.4, .9,  .1, -.2,
                                   -.3, .4, 0,  .2, -.5, 1.1, .8, .5,  -.1, .2};

void expect_near(const Vec3<double>& a, const Vec3<double>& b, double tolerance) {
    EXPECT_NEAR(a.x, b.x, tolerance);
    EXPECT_NEAR(a.y, b.y, tolerance);
    EXPECT_NEAR(a.z, b.z, tolerance);
}

struct Gradient {
    std::vector<double> rows;
    Vec3<double> direction;
};
template <class Model> Gradient gradient(const std::vector<double>& rows, const Vec3<double>& d, int sites) {
    Gradient g{std::vector<double>(rows.size()), {}};
    Model::residual_backward(rows.data(), d, sites, kGradient, g.rows.data(), g.direction);
    return g;
}

std::vector<double> random_rows(double raw_temperature) {
    std::vector<double> p(Sv::kMaxResidual);
    for (int k = 0; k < Sv::kMaxResidual; ++k) p[k] = k % 7 == 3 ? raw_temperature : std::sin(3. * k * k + 1);
    return p;
}

TEST(Sv, GoldenValuesAndGradients) {
    expect_near(Three::residual(kRows.data(), kView.unit, 3), {-.0601452381, .264440558, .117362828}, 1e-9);
    const double want[21] = {-.0319236553, .0491133158,  .0736699738,  -.103438269, .286995687,  -.143497843,
                             .0717489217,  -.0675183079, -.0174896822, -.112666092, .159763838,  .556683704,
                             -.278341852,  .139170926,   .0405068997,  .172154324,  .0708870745, -.253076055,
                             .156320609,   -.0781603045, .0390801522};
    const Gradient g = gradient<Three>(kRows, kView.unit, 3);
    for (int k = 0; k < 21; ++k) EXPECT_NEAR(g.rows[k], want[k], 1e-9) << k;
    expect_near(direction_pullback(kView, g.direction), {.0478532081, -.0822382954, .0388744609}, 1e-10);
}

TEST(Sv, FewerActiveSitesAreASmallerModel) {
    const auto rows = random_rows(1);
    expect_near(Sv::residual(rows.data(), kView.unit, 3), Three::residual(rows.data(), kView.unit, 3), 1e-15);
}

TEST(Sv, InitialSitesAndColors) {
    const double want[21] = {.186652,  .857143,  .480070,  -.735946, .571429,  -.363115, .920121,
                             .285714,  -.267853, -.519179, 0,        .854666,  -.186385, -.285714,
                             -.940015, .661448,  -.571429, .485752,  -.512066, -.857143, .055624};
    std::vector<float> row(Sv::kMaxResidual, 9.0f);
    appearance::sv_info().init_residual(7, row.data());
    for (int i = 0; i < 7; ++i) {
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(row[7 * i + c], want[3 * i + c], 1e-6) << i;
        for (int c = 3; c < 7; ++c) EXPECT_EQ(row[7 * i + c], 0);
    }
    // Sites and temperatures have no gradient if all colours are equal.
    const Gradient g = gradient<Sv>({row.begin(), row.end()}, kView.unit, 7);
    for (int k = 0; k < Sv::kMaxResidual; ++k) {
        if (k % 7 < 4)
            EXPECT_EQ(g.rows[k], 0) << k;
        else
            EXPECT_NE(g.rows[k], 0) << k;
    }
}

TEST(Sv, Invariants) {
    for (const double raw_temperature : {-2., 0., 3.}) {
        const auto rows = random_rows(raw_temperature);
        const Gradient g = gradient<Sv>(rows, kView.unit, 7);
        double logits = 0;
        Vec3<double> colors{0, 0, 0};
        auto shifted = rows, longer = rows;
        for (int i = 0; i < 7; ++i) {
            const double *p = &rows[7 * i], *d = &g.rows[7 * i];
            EXPECT_NEAR(p[0] * d[0] + p[1] * d[1] + p[2] * d[2], 0, 1e-14) << "a site's length is free";
            const Vec3<double> s = Vec3<double>{p[0], p[1], p[2]} *
                                   (1 / std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])),
                               e = s - kView.unit;
            logits += d[3] / (-std::exp(p[3]) * std::sqrt(dot(e, e)));
            colors += {d[4], d[5], d[6]};
            for (int c = 0; c < 3; ++c) shifted[7 * i + 4 + c] += 2, longer[7 * i + c] *= 10;
        }
        EXPECT_NEAR(logits, 0, 1e-14);
        expect_near(colors, kGradient, 1e-14);
        const Vec3<double> r = Sv::residual(rows.data(), kView.unit, 7);
        expect_near(Sv::residual(shifted.data(), kView.unit, 7), r + Vec3<double>{2, 2, 2}, 1e-14);
        expect_near(Sv::residual(longer.data(), kView.unit, 7), r, 1e-14);
        EXPECT_NEAR(gradient<Sv>(longer, kView.unit, 7).rows[1] * 10, g.rows[1], 1e-14);

        auto swapped = rows;
        std::swap_ranges(swapped.begin(), swapped.begin() + 7, swapped.begin() + 14);
        const Gradient h = gradient<Sv>(swapped, kView.unit, 7);
        expect_near(h.direction, g.direction, 1e-14);
        for (int c = 0; c < 7; ++c) EXPECT_NEAR(h.rows[c], g.rows[14 + c], 1e-14);
    }
}

TEST(Sv, ColdIsTheMeanAndHotTheNearestSite) {
    auto rows = random_rows(-80);
    Vec3<double> mean{0, 0, 0};
    double nearest = 9;
    Vec3<double> color;
    for (int i = 0; i < 7; ++i) {
        const double* p = &rows[7 * i];
        const Vec3<double> c{p[4], p[5], p[6]}, r{p[0], p[1], p[2]}, e = r * (1 / std::sqrt(dot(r, r))) - kView.unit;
        mean += c * (1. / 7);
        if (dot(e, e) < nearest) nearest = dot(e, e), color = c;
    }
    expect_near(Sv::residual(rows.data(), kView.unit, 7), mean, 1e-14);
    for (const double hot : {11., 90., 1e30})
        expect_near(Sv::residual(random_rows(hot).data(), kView.unit, 7), color, 1e-9);
}

TEST(Sv, GradientsAreRightCloseToASite) {
    for (const double distance : {1e-1, 1e-2, 1e-3}) {
        for (const double raw_temperature : {-2., 1., 5.}) {
            auto p = random_rows(raw_temperature);
            const Vec3<double> raw{p[0], p[1], p[2]}, s = raw * (1 / std::sqrt(dot(raw, raw)));
            const Vec3<double> e = s + cross(s, Vec3<double>{.6, 0, .8}) * distance, d = e * (1 / std::sqrt(dot(e, e)));
            const Gradient g = gradient<Sv>(p, d, 7);
            const double h = 1e-3 * distance / std::max(1.0, distance * std::exp(raw_temperature));
            const auto compare = [&](double analytic, const auto& f) {
                const double numeric = (8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h);
                EXPECT_NEAR(analytic, numeric, 1e-8 * std::exp(std::max(raw_temperature, 0.0)))
                    << distance << " " << raw_temperature;
            };
            for (int k = 0; k < 14; ++k) {
                compare(g.rows[k], [&](double x) {
                    auto q = p;
                    q[k] += x;
                    return dot(Sv::residual(q.data(), d, 7), kGradient);
                });
            }
            for (const Vec3<double>& v : {Vec3<double>{1, 0, 0}, Vec3<double>{0, .6, .8}}) {
                const Vec3<double> t = v - d * dot(v, d);
                compare(dot(g.direction, t), [&](double x) {
                    const Vec3<double> n = d + t * x;
                    return dot(Sv::residual(p.data(), n * (1 / std::sqrt(dot(n, n))), 7), kGradient);
                });
            }
        }
    }
}

TEST(Sv, StaysFiniteAtEveryExtreme) {
    const Vec3<float> d{.26726124f, .53452248f, .80178373f};
    for (const float length : {0.f, 1e-30f, 1e-8f, 1.f, 1e10f, 1e30f})
        for (const float temperature : {-1e30f, -1e3f, 0.f, 11.f, 89.f, 1e3f, 1e30f})
            for (const int same : {0, 1, 7}) {  // sites exactly in the direction
                std::vector<float> p(Sv::kMaxResidual), dp(p.size());
                for (int k = 0; k < Sv::kMaxResidual; ++k)
                    p[k] = k % 7 == 3 ? temperature : k % 7 < 3 ? length * std::sin(k + 1.f) : std::sin(5.f * k);
                for (int i = 0; i < same; ++i)
                    p[7 * i] = length * d.x, p[7 * i + 1] = length * d.y, p[7 * i + 2] = length * d.z;
                Vec3<float> dd;
                const Vec3<float> r = Sv::residual(p.data(), d, 7);
                Sv::residual_backward(p.data(), d, 7, {1, -1, 1}, dp.data(), dd);
                bool finite = std::isfinite(r.x + r.y + r.z) && std::isfinite(dd.x + dd.y + dd.z);
                for (const float x : dp) finite = finite && std::isfinite(x);
                ASSERT_TRUE(finite) << length << " " << temperature << " " << same;
                EXPECT_LE(std::abs(r.x), 1.0001f) << "a mean of the colours";
            }
}

TEST(Sv, NanIsNotHidden) {
    for (int k = 0; k < 7; ++k) {
        std::vector<float> p(Sv::kMaxResidual, .5f);
        p[7 + k] = std::nanf("");
        const Vec3<float> r = Sv::residual(p.data(), {.6f, 0, .8f}, 7);
        EXPECT_TRUE(std::isnan(r.x + r.y + r.z)) << k;
    }
}

TEST(Sv, LimitedTemperaturesComeBack) {
    // Two sites at nearly the same distance give the temperature a gradient even at the limit.
    std::vector<double> p = {1, .001, 0, 12, 1, 0, 0, 1, -.00101, 0, 12, 0, 0, 0};
    using Two = appearance::SphericalVoronoi<2>;
    const Gradient up = gradient<Two>(p, {1, 0, 0}, 2);
    std::swap(p[4], p[11]);
    const Gradient down = gradient<Two>(p, {1, 0, 0}, 2);
    for (const int k : {3, 10}) {
        EXPECT_GE(up.rows[k], 0);
        EXPECT_GE(down.rows[k], 0);
        EXPECT_GT(up.rows[k] + down.rows[k], 0) << "free in one direction";
    }
}

TEST(Sv, WhereOneSiteTakesAllNothingIsLeftOfTheDifferences) {
    // At temperatures of 2e4 the nearest site has all the weight, and the others add less than 1e-30. The naive formula
    // would leave the rounding error of the mean colour, a few 1e-8 times the temperature, in every gradient of that
    // site.
    const auto wide = random_rows(std::log(2e4));
    const std::vector<float> rows(wide.begin(), wide.end());
    std::vector<float> g(rows.size());
    Vec3<float> direction;
    Sv::residual_backward(rows.data(), {.6f, .48f, .64f}, 7, {.3f, -.7f, .2f}, g.data(), direction);
    for (int k = 0; k < Sv::kMaxResidual; ++k) EXPECT_LT(k % 7 < 4 ? std::abs(g[k]) : 0, 1e-20f) << k;
}

TEST(Sv, EqualColorsLeaveNoGradientButTheirOwn) {
    std::vector<float> rows(Sv::kMaxResidual), g(rows.size());
    for (int k = 0; k < Sv::kMaxResidual; ++k) rows[k] = k % 7 < 4 ? std::sin(3.0f * k * k + 1) : 0.1f * float(k % 7);
    Vec3<float> direction;
    Sv::residual_backward(rows.data(), {.6f, .48f, .64f}, 7, {.3f, -.7f, .2f}, g.data(), direction);
    for (int k = 0; k < Sv::kMaxResidual; ++k) EXPECT_EQ(k % 7 < 4 ? g[k] : 0, 0) << k;
}

TEST(Sv, LongSitesKeepTheirDirection) {
    auto rows = random_rows(1);
    const std::vector<double> unscaled = rows;
    const Vec3<float> d{.6f, .48f, .64f};
    const std::vector<float> near(rows.begin(), rows.end());
    const Vec3<float> want = Sv::residual(near.data(), d, 7);
    for (const double length : {1e15, 1e18, 1e20, 1e38}) {  // squares overflow in float above 1.8e19
        for (int i = 0; i < 7; ++i)
            for (int c = 0; c < 3; ++c) rows[7 * i + c] = unscaled[7 * i + c] * length;
        const std::vector<float> far(rows.begin(), rows.end());
        const Vec3<float> got = Sv::residual(far.data(), d, 7);
        EXPECT_NEAR(got.x, want.x, 1e-6) << length;
        EXPECT_NEAR(got.y, want.y, 1e-6) << length;
        EXPECT_NEAR(got.z, want.z, 1e-6) << length;
    }
}

TEST(Sv, ScheduleFreezesSitesAndTemperatures) {
    const ModelInfo& info = appearance::sv_info();
    EXPECT_EQ(info.initial_degree, 7);
    EXPECT_EQ(info.residual_width(7), 49);
    const AppearanceRates rates = info.rates(7, {});
    ASSERT_EQ(rates.residual.size(), 49u);
    for (int i = 0; i < 7; ++i)
        for (int c = 0; c < 7; ++c) {
            const Schedule& s = rates.residual[7 * i + c];
            const double full = c < 3 ? .002 : c == 3 ? .006 : .0008;
            EXPECT_DOUBLE_EQ(s.at(999), c < 4 ? 0 : full);
            EXPECT_DOUBLE_EQ(s.at(1000), full);
            EXPECT_NEAR(s.at(14000), c < 4 ? .55 * full : full, 1e-15);
            EXPECT_DOUBLE_EQ(s.at(27001), c < 4 ? 0 : full);
        }
    EXPECT_DOUBLE_EQ(rates.base.at(30000), .0008);
}

}  // namespace
}  // namespace gs
