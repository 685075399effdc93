// SPDX-License-Identifier: Apache-2.0
// NASG and NASGabor: golden vectors, limits at the axis and its antipode, gradients near them, clamps, rates.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "appearance/model_info.h"
#include "appearance/nasg/nasg.h"

namespace gs {

namespace appearance {
const ModelInfo& nasg_info();
const ModelInfo& nasgabor_info();
}  // namespace appearance

namespace {

using appearance::LobeDensity;
// These models use the reference's frame, for which golden values exist. The WholeSphere test below compares the
// registered models with them.
using Nasg = appearance::NasgLobes<false, 1, false>;
using Nasgabor = appearance::NasgLobes<true, 1, false>;
template <class T> using LobeFrame = appearance::LobeFrame<T, false>;

const Vec3<double> kMean{1, 2, 3}, kGradient{1, -.5, .25};

void expect_near(const Vec3<double>& a, const Vec3<double>& b, double tolerance) {
    EXPECT_NEAR(a.x, b.x, tolerance);
    EXPECT_NEAR(a.y, b.y, tolerance);
    EXPECT_NEAR(a.z, b.z, tolerance);
}

template <class Model, std::size_t N>
void expect_golden(const std::array<double, N>& raw, const Vec3<double>& residual, const std::array<double, N>& dL_draw,
                   const Vec3<double>& dL_dmean) {
    const auto d = view_direction(kMean, Vec3<double>{0, 0, 0});
    expect_near(Model::residual(raw.data(), d.unit, 1), residual, 1e-10);
    std::array<double, N> got{};
    Vec3<double> dd;
    Model::residual_backward(raw.data(), d.unit, 1, kGradient, got.data(), dd);
    for (std::size_t k = 0; k < N; ++k) EXPECT_NEAR(got[k], dL_draw[k], 1e-10) << k;
    expect_near(direction_pullback(d, dd), dL_dmean, 1e-10);
}

TEST(Nasg, GoldenValuesAndGradients) {
    expect_golden<Nasg, 8>(
        {.3, -.4, .2, .5, -.3, .1, -.2, .7}, {.00931994188, -.0184565418, .0565143563},
        {.0164563244, .0507667236, -.0191921297, -.0144432101, .00390522381, .0925809767, -.0449335054, .0148386052},
        {-.00192157075, .0133592882, -.00826566852});
    expect_golden<Nasgabor, 9>({.3, -.4, .2, .5, -.3, -1, .1, -.2, .7}, {.00556250042, -.0110155753, .0337299454},
                               {.051504422, .0336536604, -.0808947548, -.00862026433, .00233078804, -.0388504698,
                                .0552558941, -.0268180473, .00885625132},
                               {-.0191738091, .0154919377, -.00393668875});
}

TEST(Nasg, GoldenFrame) {
    const double raw[] = {.3, -.4, .2};
    const auto f = LobeFrame<double>::of(raw);
    expect_near(f.x, {-.9596554, .213841945, -.182573642}, 1e-8);
    expect_near(f.y, {-.0803081901, .413817524, .906810703}, 1e-8);
    expect_near(f.z, {.269466337, .884887947, -.379948962}, 1e-8);
    expect_near(cross(f.z, f.x), f.y, 1e-15);
    for (const Vec3<double>& e : {f.x, f.y, f.z}) EXPECT_NEAR(dot(e, e), 1, 1e-15);
}

TEST(Nasg, InitialLobe) {
    std::vector<float> row(8);
    appearance::nasg_info().init_residual(1, row.data());
    const std::vector<double> raw(row.begin(), row.end());
    const auto f = LobeFrame<double>::of(raw.data());
    expect_near(f.x, {-1, 0, 0}, 1e-15);
    expect_near(f.z, {0, 1, 0}, 1e-15);
    EXPECT_NEAR(LobeDensity<double>::of({0, 0, 1}, raw[3], raw[4]).value, .154182772, 1e-8);
    EXPECT_NEAR(Nasg::residual(raw.data(), f.z, 1).x, .0712504, 2e-7) << "not zero: the lobe appears when it activates";
}

TEST(Nasg, AimedLobesPointThere) {
    using Whole = appearance::Nasg;
    for (const ModelInfo* info : {&appearance::nasg_info(), &appearance::nasgabor_info()})
        for (double y = -1; y <= 1; y += 0.05)
            for (double turn = 0; turn < 6.28; turn += 0.1) {
                const double r = std::sqrt(std::max(0.0, 1 - y * y));
                const Vec3<double> wanted{r * std::cos(turn), y, r * std::sin(turn)};
                std::vector<float> row(std::size_t(info->residual_width(1)));
                info->init_residual(1, row.data());
                const std::vector<float> before = row;
                info->aim_residual(1, wanted, row.data());
                EXPECT_TRUE(std::equal(before.begin() + 2, before.end(), row.begin() + 2)) << "only the axis turns";
                const std::vector<double> raw(row.begin(), row.end());
                const double cosine = dot(Whole::from_lobe(Whole::Frame<double>::of(raw.data()).z), wanted);
                EXPECT_GT(cosine, std::cos(24 * M_PI / 180)) << wanted.x << " " << wanted.y << " " << wanted.z;
                if (wanted.y > -0.9 * std::hypot(wanted.y, wanted.z) && std::abs(wanted.x) < 0.97) {
                    EXPECT_NEAR(cosine, 1, 1e-6);
                }
            }
}

TEST(Nasg, DensityIntegratesToOne) {
    for (const double lambda : {.01, .5, 10., 100.})
        for (const double a : {.01, .5, 10., 100.}) {
            constexpr int kRings = 4000, kSectors = 128;
            double sum = 0;
            for (int i = 0; i < kRings; ++i) {
                // Rings have equal areas for small lambda and crowd at the axis for large lambda: z = 1 - 2 u^2.
                const double u = (i + .5) / kRings, z = 1 - 2 * u * u, r = std::sqrt(1 - z * z);
                for (int j = 0; j < kSectors; ++j) {
                    const double phi = 2 * M_PI * (j + .5) / kSectors;
                    sum += LobeDensity<double>::of({r * std::cos(phi), r * std::sin(phi), z}, std::log(lambda),
                                                   std::log(a))
                               .value *
                           4 * u;
                }
            }
            EXPECT_NEAR(sum * 2 * M_PI / (double(kRings) * kSectors), 1, 1e-4) << lambda << " " << a;
        }
}

template <class T> LobeDensity<T> density_at(double s, double azimuth, bool antipode, double lambda, double a) {
    const double z = std::sqrt(1 - s * s);
    return LobeDensity<T>::of({T(s * std::cos(azimuth)), T(s * std::sin(azimuth)), T(antipode ? -z : z)},
                              T(std::log(lambda)), T(std::log(a)));
}

TEST(Nasg, IsContinuousAtTheAxis) {
    for (const double lambda : {1e-7, .5, 100., 1e4})
        for (const double a : {1e-3, .5, 1e4}) {
            const double peak = std::sqrt(1 + a) / (4 * M_PI) * 2 * lambda / -std::expm1(-2 * lambda);
            EXPECT_NEAR(density_at<double>(0, 0, false, lambda, a).value, peak, 1e-6 * peak);
            EXPECT_NEAR(density_at<float>(0, 0, false, lambda, a).value, peak, 2e-6 * peak);
            for (const double azimuth : {0., .7, 1.5}) {
                EXPECT_NEAR(density_at<double>(1e-6, azimuth, false, lambda, a).value, peak, 1e-3 * peak);
                // The direction's gradient vanishes with the distance to the axis: the axis is a maximum.
                const auto d = density_at<double>(1e-12, azimuth, false, lambda, a);
                const Vec3<double> slope = d.slope_direction({1e-12 * std::cos(azimuth), 1e-12 * std::sin(azimuth), 1});
                EXPECT_LT(std::abs(slope.x) + std::abs(slope.y), 1e-2);
            }
        }
}

TEST(Nasg, AntipodeIsDarkExceptAcrossTheRidge) {
    // The density stays N exp(-2 lambda) at v_x = 0 and falls to 0 at every other azimuth.
    const double lambda = .5, a = .5, bottom = std::sqrt(1.5) / (4 * M_PI) / -std::expm1(-1) * std::exp(-1);
    EXPECT_NEAR(density_at<double>(0, 0, true, lambda, a).value, bottom, 1e-3 * bottom);
    EXPECT_NEAR(density_at<float>(0, 0, true, lambda, a).value, bottom, 1e-3 * bottom);
    EXPECT_NEAR(density_at<double>(1e-5, M_PI / 2, true, lambda, a).value, bottom, 1e-3 * bottom);
    EXPECT_LT(density_at<double>(1e-6, 0, true, lambda, a).value, 1e-5);
    EXPECT_LT(density_at<double>(1e-6, 0, true, lambda, a).value, density_at<double>(1e-4, 0, true, lambda, a).value);
}

/// Returns the largest relative difference between analytic gradients and fourth-order central differences at a
/// direction `s` away from the axis (or its antipode). The gradients of the direction, of the angles and of all other
/// parameters are each compared relative to their own length.
template <class Model>
double gradient_error(double s, double azimuth, bool antipode, double raw_sharpness, double raw_anisotropy, double h) {
    std::vector<double> p = {.3, -.4, .2, raw_sharpness, raw_anisotropy};
    if (Model::kPerLobe == 9) p.push_back(-.3);
    p.insert(p.end(), {.8, .3, -.6});
    const auto f = LobeFrame<double>::of(p.data());
    const double z = std::sqrt(1 - s * s) * (antipode ? -1 : 1);
    const Vec3<double> v{s * std::cos(azimuth), s * std::sin(azimuth), z}, d = f.world(v);
    std::vector<double> dp(p.size());
    Vec3<double> dd;
    Model::residual_backward(p.data(), d, 1, kGradient, dp.data(), dd);
    const auto difference = [&](const auto& f) { return (8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h); };
    double worst = 0, error = 0, length = 0;
    const auto compare = [&](double analytic, double numeric) {
        error = std::max(error, std::abs(analytic - numeric));
        length = std::hypot(length, analytic);
    };
    const auto end_group = [&] { worst = std::max(worst, error / length), error = length = 0; };
    for (std::size_t k = 0; k < p.size(); ++k) {
        compare(dp[k], difference([&](double x) {
                    auto q = p;
                    q[k] += x;
                    return dot(Model::residual(q.data(), d, 1), kGradient);
                }));
        if (k == 2 || k + 1 == p.size()) end_group();
    }
    for (const Vec3<double>& e : {f.x, f.y}) {
        const Vec3<double> t = e - d * dot(e, d);
        compare(dot(dd, t), difference([&](double x) {
                    const Vec3<double> n = d + t * x;
                    return dot(Model::residual(p.data(), n * (1 / std::sqrt(dot(n, n))), 1), kGradient);
                }));
    }
    end_group();
    return worst;
}

TEST(Nasg, GradientsAreRightNearTheAxisAndTheAntipode) {
    for (const double azimuth : {.0, .4, 1.1, 1.5708, 4.}) {
        for (const double s : {.5, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5}) {
            SCOPED_TRACE(testing::Message() << "sine " << s << ", azimuth " << azimuth);
            for (const double shape : {-3., .5, 3.}) {
                // Near the axis the lobe is smooth at its own scale at any distance; the carrier oscillates faster.
                const double h = 1e-3 * std::min(std::exp(-shape), 1.0);
                // The gradient vanishes towards the axis; the rounding error of the differences does not.
                const double tolerance = 1e-6 + 1e-9 / s;
                EXPECT_LT(gradient_error<Nasg>(s, azimuth, false, shape, shape, h), tolerance) << shape;
                EXPECT_LT(gradient_error<Nasgabor>(s, azimuth, false, shape, shape, 0.2 * h), tolerance) << shape;
            }
            if (s < 2e-4) {
                EXPECT_LT(gradient_error<Nasg>(s, azimuth, false, 9, 9, 1e-6), 1e-4) << "the narrowest lobe";
            }
            // At the antipode the gradient varies with the logarithm of the distance.
            if (s < 1e-3) continue;
            EXPECT_LT(gradient_error<Nasg>(s, azimuth, true, -1, .5, 1e-3 * s), 1e-5);
            EXPECT_LT(gradient_error<Nasgabor>(s, azimuth, true, -1, .5, 1e-3 * s), 1e-5);
        }
    }
}

TEST(Nasg, StaysFiniteAtEveryExtreme) {
    const float values[] = {-1e30f, -1e3f, -9, 0, 9, 1e3f, 1e30f};
    for (const float sharpness : values)
        for (const float anisotropy : values)
            for (const float angle : {-1e3f, 0.f, .3f, 1e3f}) {
                const float raw[9] = {angle, .2f, -angle, sharpness, anisotropy, sharpness, 1e3f, -1e3f, .1f};
                const auto f = LobeFrame<float>::of(raw);
                for (const float s : {0.f, 1e-30f, 1e-8f, 1e-7f, 1e-5f, 4e-4f, 6e-4f, .1f, 1.f})
                    for (const float azimuth : {0.f, .5f, 1.57079633f})
                        for (const float sign : {-1.f, 1.f}) {
                            const Vec3<float> d =
                                f.world({s * std::cos(azimuth), s * std::sin(azimuth), sign * std::sqrt(1 - s * s)});
                            float dp[9] = {};
                            Vec3<float> dd;
                            const Vec3<float> r = Nasgabor::residual(raw, d, 1);
                            Nasgabor::residual_backward(raw, d, 1, {1, -1, 1}, dp, dd);
                            bool finite = std::isfinite(r.x + r.y + r.z) && std::isfinite(dd.x + dd.y + dd.z);
                            for (const float x : dp) finite = finite && std::isfinite(x);
                            ASSERT_TRUE(finite) << sharpness << " " << anisotropy << " " << angle << " " << s << " "
                                                << azimuth << " " << sign;
                        }
            }
}

TEST(Nasg, NanIsNotHidden) {
    for (int k = 0; k < 9; ++k) {
        float raw[9] = {.3f, -.4f, .2f, .5f, -.3f, -1, .1f, -.2f, .7f};
        raw[k] = std::nanf("");
        const Vec3<float> r = Nasgabor::residual(raw, {.6f, 0, .8f}, 1);
        EXPECT_TRUE(std::isnan(r.x + r.y + r.z)) << k;
    }
}

TEST(Nasg, ClampedShapesComeBack) {
    // Off the axis a narrower lobe is darker: a pixel that should be brighter pulls towards a smaller sharpness.
    const double raw[8] = {0, 0, 0, 11, -2, 1, 1, 1};
    const auto f = LobeFrame<double>::of(raw);
    const Vec3<double> off = f.world({.02, 0, std::sqrt(1 - .0004)});
    for (const double sign : {-1., 1.}) {
        double dp[8] = {};
        Vec3<double> dd;
        Nasg::residual_backward(raw, off, 1, {sign, 0, 0}, dp, dd);
        if (sign < 0) {
            EXPECT_GT(dp[3], 0) << "descent lowers it";
        } else {
            EXPECT_EQ(dp[3], 0) << "descent would raise it further";
        }
    }
}

TEST(Nasg, SharpnessOfUniformLobesHasAGradient) {
    // d ln B/d ln lambda -> lambda (1 + 2 (K^(1+kappa) - 1)) as lambda -> 0. In float the error of 1 - t/(e^t - 1) is
    // larger than that.
    for (const float raw : {-13.f, -10.f, -7.f, -2.5f, -2.f}) {
        const auto narrow = LobeDensity<float>::of({.6f, .48f, .64f}, raw, -1.f);
        const auto wide = LobeDensity<double>::of({.6f, .48f, .64f}, raw, -1.);
        EXPECT_NEAR(narrow.slope_sharpness() / wide.slope_sharpness(), 1, 1e-5) << raw;
    }
    for (const double t : {1e-6, 1e-3, .1, .2499999, .2500001, 1., 40.}) {
        const long double exact = 1 - (long double)(t) / std::expm1((long double)(t));
        EXPECT_NEAR(double(LobeDensity<double>::norm_slope(t) / exact), 1, 1e-11 / std::max(t, 1e-4)) << t;
    }
    EXPECT_EQ(LobeDensity<double>::sharpness_gradient(-20, 1), 0) << "no sharpness below the smallest";
    EXPECT_EQ(LobeDensity<double>::sharpness_gradient(-20, -1), -1) << "but back from it";
}

TEST(Nasgabor, TheCarrierHasExactZeros) {
    const auto c = appearance::Carrier<float>::of(0, float(M_PI / 20));  // k = 20, phase pi
    EXPECT_LT(c.value(), 1e-14f) << "(1 + cos)/2 would be 0 or 3e-8";
    EXPECT_GT(c.value(), 0);
}

TEST(Nasg, SaturatedAmplitudesKeepAGradient) {
    const float raw[8] = {0, 0, 0, 0, 0, 12, -12, 30};
    float dp[8] = {};
    Vec3<float> dd;
    Nasg::residual_backward(raw, {0, 1, 0}, 1, {1, 1, 1}, dp, dd);
    for (int k = 5; k < 8; ++k) EXPECT_GT(dp[k], 0) << k;
}

TEST(Nasg, IsotropicLobeHasNoRollAndMirrorsInX) {
    double raw[8] = {.3, -.4, .2, .5, -60, .1, -.2, .7}, dp[8] = {};
    const auto d = view_direction(kMean, Vec3<double>{0, 0, 0});
    Vec3<double> dd;
    Nasg::residual_backward(raw, d.unit, 1, kGradient, dp, dd);
    EXPECT_NEAR(dp[2], 0, 1e-8);
    EXPECT_EQ(LobeDensity<double>::of({.3, .4, .866}, 1, 1).value,
              LobeDensity<double>::of({-.3, .4, .866}, 1, 1).value);
}

TEST(Nasgabor, WithoutFrequencyEqualsNasg) {
    const double a[8] = {.3, -.4, .2, .5, -.3, .1, -.2, .7}, b[9] = {.3, -.4, .2, .5, -.3, -40, .1, -.2, .7};
    const Vec3<double> d = view_direction(kMean, Vec3<double>{0, 0, 0}).unit;
    expect_near(Nasg::residual(a, d, 1), Nasgabor::residual(b, d, 1), 1e-15);
}

TEST(Nasg, WholeSphereIsTheSameLobeWhereBothReach) {
    using appearance::LobeAngle;
    const Vec3<double> d = view_direction(kMean, Vec3<double>{0, 0, 0}).unit;
    for (const double raw : {-.8, -.3, .0, .2, .8}) {  // theta within (0, pi)
        const double p[9] = {raw, -.4, .2, .5, -.3, -1, .1, -.2, .7};
        double q[9], dp[9] = {}, dq[9] = {};
        std::copy(p, p + 9, q);
        const double theta = 2 * std::acos(std::tanh(raw)) - M_PI / 2;
        ASSERT_GT(std::sin(theta), 0);
        q[0] = std::atanh(std::cos(theta));
        const Vec3<double> turned{d.z, d.y, -d.x};
        expect_near(appearance::Nasgabor::residual(p, d, 1), Nasgabor::residual(q, turned, 1), 1e-14);
        Vec3<double> dd, dd_turned;
        appearance::Nasgabor::residual_backward(p, d, 1, kGradient, dp, dd);
        Nasgabor::residual_backward(q, turned, 1, kGradient, dq, dd_turned);
        for (int k = 1; k < 9; ++k) EXPECT_NEAR(dp[k], dq[k], 1e-14) << k;
        // d raw' / d raw: both angles change by -sin d raw, one of them by twice that.
        EXPECT_NEAR(dp[0], dq[0] * 2 * LobeAngle<double>::of(raw).sin / std::sin(theta), 1e-13);
        expect_near(dd, {-dd_turned.z, dd_turned.y, dd_turned.x}, 1e-14);
    }
}

TEST(Nasg, AxesReachTheWholeSphere) {
    // The largest axis components, of either sign, that raw angles can give.
    double largest[6] = {};
    for (double theta = -7; theta <= 7; theta += .05)
        for (double phi = -4; phi <= 4; phi += .05) {
            const double raw[3] = {theta, phi, 0};
            const Vec3<double> z = appearance::LobeFrame<double, true>::of(raw).z;
            EXPECT_NEAR(dot(z, z), 1, 1e-14);
            const double sides[6] = {z.x, -z.x, z.y, -z.y, z.z, -z.z};
            for (int k = 0; k < 6; ++k) largest[k] = std::max(largest[k], sides[k]);
        }
    for (const double x : largest) EXPECT_GT(x, .999);
    const double start[3] = {};
    expect_near(appearance::LobeFrame<double, true>::of(start).z, {0, 1, 0}, 1e-15);
}

TEST(Nasg, SeveralLobesAddUp) {
    using Two = appearance::NasgLobes<true, 2, false>;
    double p[18], dp[18] = {}, second[9] = {};
    for (int k = 0; k < 18; ++k) p[k] = std::sin(k + 1.);
    const Vec3<double> d = view_direction(kMean, Vec3<double>{0, 0, 0}).unit;
    expect_near(Two::residual(p, d, 2), Nasgabor::residual(p, d, 1) + Nasgabor::residual(p + 9, d, 1), 1e-15);
    Vec3<double> dd, dd_second;
    Two::residual_backward(p, d, 2, kGradient, dp, dd);
    Nasgabor::residual_backward(p + 9, d, 1, kGradient, second, dd_second);
    for (int k = 0; k < 9; ++k) EXPECT_NEAR(dp[9 + k], second[k], 1e-15);
    expect_near(Two::residual(p, d, 1), Nasgabor::residual(p, d, 1), 1e-15);
}

TEST(Nasg, RatesAreConstantOrFollowTheCameraSpacing) {
    for (const ModelInfo* info : {&appearance::nasg_info(), &appearance::nasgabor_info()}) {
        EXPECT_EQ(info->initial_degree, 0);
        EXPECT_EQ(info->default_max_degree, 1);
        const auto rates = [&](double spacing) { return info->rates(1, {spacing, {{"lobe-lr", std::nullopt}}}); };
        EXPECT_DOUBLE_EQ(info->rates(1, {3, {{"lobe-lr", .001}}}).residual.at(0).at(1), .001)
            << "given: whatever the cameras are";
        EXPECT_DOUBLE_EQ(info->rates(1, {}).residual.at(0).at(1), .0025);
        EXPECT_DOUBLE_EQ(rates(.3536).residual.at(0).at(1), .0025);
        EXPECT_DOUBLE_EQ(rates(.7072).residual.at(0).at(7000), .000625);
        EXPECT_DOUBLE_EQ(rates(1e-6).residual.at(0).at(1), 2.5) << "factor at most 1000";
        EXPECT_DOUBLE_EQ(rates(1e9).residual.at(0).at(1), 2.5e-6) << "factor at least 1/1000";
        EXPECT_DOUBLE_EQ(rates(1).base.at(7000), .00025);
        EXPECT_NEAR(rates(1).base.at(22000), .000125, 1e-12);
    }
}

}  // namespace
}  // namespace gs
