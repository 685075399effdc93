// SPDX-License-Identifier: Apache-2.0
// PPISP: gradients by finite differences, the identity, regularisers from their definition, extremes.
#include "kernels/ppisp/ppisp_device.h"

#include <gtest/gtest.h>

#include <random>

namespace gs {
namespace {

constexpr int kRaw = kIspFrameValues + kIspCameraValues;

/// A small image, the parameters of its correction, and the weights of a loss.
template <class Real> struct Isp {
    int w = 7, h = 5;
    std::vector<Real> raw;  ///< one frame, then one camera
    std::vector<Vec3<Real>> image, weights;

    Vec2<Real> uv(int i) const { return isp_uv<Real>(i % w, i / w, w, h); }
    std::vector<Vec3<Real>> correct() const {
        const IspFrame<Real> frame = isp_frame(raw.data());
        const IspCamera<Real> camera = isp_camera(raw.data() + kIspFrameValues);
        std::vector<Vec3<Real>> out;
        for (int i = 0; i < w * h; ++i) out.push_back(isp_forward(frame, camera, image[i], uv(i)));
        return out;
    }
    Real loss() const {
        Real sum = 0;
        const auto out = correct();
        for (std::size_t i = 0; i < out.size(); ++i) sum += dot(out[i], weights[i]);
        return sum;
    }
    /// Returns dL/draw, then dL/dimage.
    std::vector<Real> gradient() const {
        const IspFrame<Real> frame = isp_frame(raw.data());
        const IspCamera<Real> camera = isp_camera(raw.data() + kIspFrameValues);
        IspSums<Real> sums{};
        std::vector<Real> out(kRaw);
        for (int i = 0; i < w * h; ++i) {
            const Vec3<Real> g = isp_backward(frame, camera, image[i], uv(i), weights[i], sums);
            out.insert(out.end(), {g.x, g.y, g.z});
        }
        isp_finish(raw.data(), raw.data() + kIspFrameValues, sums, out.data(), out.data() + kIspFrameValues);
        return out;
    }
};

template <class Real = double> std::vector<Real> identity() {
    const PpispState state = identity_ppisp(1, 1);
    return {state.param.begin(), state.param.end()};
}

/// The parameters that are moved away from the identity.
struct Stages {
    bool exposure = true, colour = true, vignetting = true, response = true;
};

Isp<double> random_isp(std::uint32_t seed, double brightest, const Stages& stages = {}) {
    std::mt19937 rng(seed);
    std::uniform_real_distribution<double> u(-1, 1);
    Isp<double> isp;
    isp.raw = identity();
    if (stages.exposure) isp.raw[0] = u(rng);
    for (int k = 1; stages.colour && k < 9; ++k) isp.raw[k] = u(rng);
    for (int c = 0; c < 3; ++c) {
        double* v = isp.raw.data() + kIspFrameValues + c * kIspVignetting;
        v[2] = -0.1;  // away from the kink at no vignetting at all
        if (!stages.vignetting) continue;
        v[0] = 0.1 * u(rng), v[1] = 0.1 * u(rng), v[2] = -0.8 + 0.2 * u(rng), v[3] = 0.2 * u(rng), v[4] = 0.2 * u(rng);
    }
    for (int k = 0; stages.response && k < 12; ++k) isp.raw[kIspFrameValues + 15 + k] += 1.5 * u(rng);
    for (int i = 0; i < isp.w * isp.h; ++i) {
        const auto colour = [&] { return brightest * (0.5 + 0.5 * u(rng)) + 1e-3; };
        isp.image.push_back({colour(), colour(), colour()});
        isp.weights.push_back({u(rng), u(rng), u(rng)});
    }
    return isp;
}

/// Compares analytic gradients with central differences. Returns how many were not zero.
int check_gradient(Isp<double> isp) {
    const std::vector<double> analytic = isp.gradient();
    std::vector<double*> value;
    for (double& x : isp.raw) value.push_back(&x);
    for (Vec3<double>& p : isp.image) value.insert(value.end(), {&p.x, &p.y, &p.z});
    double scale = 0;
    for (int k = 0; k < kRaw; ++k) scale = std::max(scale, std::abs(analytic[k]));
    int nonzero = 0;
    for (std::size_t k = 0; k < value.size(); ++k) {
        double error = 1e9, fd = 0;
        for (const double h : {1e-5, 1e-6, 1e-7}) {  // a kink that lies between is avoided by another step
            const double x = *value[k];
            // Fourth order: between it and rounding there is room for 1e-6 of small gradients.
            const auto at = [&](double d) {
                *value[k] = x + d;
                return isp.loss();
            };
            fd = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h);
            *value[k] = x;
            error = std::min(error, std::abs(fd - analytic[k]) / std::max({std::abs(analytic[k]), 1e-3 * scale, 1e-4}));
            if (error <= 1e-6) break;
        }
        EXPECT_LE(error, 1e-6) << "value " << k << " analytic " << analytic[k] << " difference " << fd;
        nonzero += analytic[k] != 0;
    }
    return nonzero;
}

TEST(Ppisp, GradientOfEachStageMatchesFiniteDifferences) {
    for (std::uint32_t seed = 0; seed < 5; ++seed) {
        check_gradient(random_isp(seed, 0.9, {true, false, false, false}));
        check_gradient(random_isp(seed, 0.9, {false, true, false, false}));
        check_gradient(random_isp(seed, 0.9, {false, false, true, false}));
        check_gradient(random_isp(seed, 0.9, {false, false, false, true}));
    }
}

TEST(Ppisp, GradientOfTheWholeChainMatchesFiniteDifferences) {
    for (std::uint32_t seed = 0; seed < 20; ++seed) EXPECT_GT(check_gradient(random_isp(seed, 0.8)), kRaw + 50);
}

TEST(Ppisp, GradientMatchesFiniteDifferencesBeyondWhite) {
    for (std::uint32_t seed = 0; seed < 20; ++seed) check_gradient(random_isp(seed, 3));
    // Saturated in all channels: nothing moves.
    Isp<double> white = random_isp(1, 1);
    for (Vec3<double>& p : white.image) p = p + Vec3<double>{20, 20, 20};
    for (const double g : white.gradient()) EXPECT_EQ(g, 0);
}

TEST(Ppisp, IdentityChangesNothing) {
    std::mt19937 rng(1);
    std::uniform_real_distribution<float> u(0, 1);
    const std::vector<float> raw = identity<float>();
    const IspFrame<float> frame = isp_frame(raw.data());
    const IspCamera<float> camera = isp_camera(raw.data() + kIspFrameValues);
    for (int i = 0; i < 200000; ++i) {
        const float scale = i % 4 ? 1 : 1e-3f;
        const Vec3<float> in{scale * u(rng), scale * u(rng), scale * u(rng)},
            out = isp_forward(frame, camera, in, {u(rng) - 0.5f, u(rng) - 0.5f});
        EXPECT_NEAR(out.x, in.x, 1e-15);  // to the last bit, but for what other channels leave beside values below 1e-8
        EXPECT_NEAR(out.y, in.y, 1e-15);
        EXPECT_NEAR(out.z, in.z, 1e-15);
    }
}

TEST(Ppisp, IdentityChangesNoEightBitPixel) {
    const std::vector<float> raw = identity<float>();
    const IspFrame<float> frame = isp_frame(raw.data());
    const IspCamera<float> camera = isp_camera(raw.data() + kIspFrameValues);
    const auto check = [&](int r, int g, int b) {
        const Vec3<float> out = isp_forward(frame, camera, {r / 255.0f, g / 255.0f, b / 255.0f}, {0.3f, -0.2f});
        EXPECT_EQ(std::lround(255 * out.x), r);
        EXPECT_EQ(std::lround(255 * out.y), g);
        EXPECT_EQ(std::lround(255 * out.z), b);
    };
    for (int v = 0; v < 256; ++v) check(v, v, v), check(v, 0, 0), check(0, v, 0), check(0, 0, v), check(v, 255, 128);
    std::mt19937 rng(2);
    for (int i = 0; i < 50000; ++i) check(rng() % 256, rng() % 256, rng() % 256);
}

TEST(Ppisp, ColourKeepsTheIntensity) {
    Isp<double> isp = random_isp(3, 0.3, {false, true, false, false});
    const IspFrame<double> frame = isp_frame(isp.raw.data());
    const IspCamera<double> camera = isp_camera(identity().data() + kIspFrameValues);
    for (int i = 0; i < isp.w * isp.h; ++i) {
        const Vec3<double> in = isp.image[i], out = isp_pixel(frame, camera, in, isp.uv(i)).balanced;
        EXPECT_NEAR(out.x + out.y + out.z, in.x + in.y + in.z, 1e-12);
    }
}

TEST(Ppisp, ColourMovesTheFourPointsToTheirTargets) {
    const Isp<double> isp = random_isp(4, 1, {false, true, false, false});
    const IspColor color = isp_color(isp.raw.data() + 1);
    const IspFrame<double> frame = isp_frame(isp.raw.data());
    const double source[4][2] = {{0, 0}, {1, 0}, {0, 1}, {1 / 3.0, 1 / 3.0}};
    for (int k = 0; k < 4; ++k) {
        const Vec3<double> v = frame.mix * Vec3<double>{source[k][0], source[k][1], 1 - source[k][0] - source[k][1]};
        const double intensity = v.x + v.y + v.z;
        EXPECT_NEAR(v.x / intensity, color.target[k].x, 1e-12) << k;
        EXPECT_NEAR(v.y / intensity, color.target[k].y, 1e-12) << k;
    }
}

/// Expects finite results for one image, forward and backward.
template <class Real> void expect_finite(const Isp<Real>& isp, const std::string& what) {
    for (const Vec3<Real>& p : isp.correct()) {
        for (const Real x : {p.x, p.y, p.z}) EXPECT_TRUE(x >= 0 && x <= Real(1.000001)) << what << " " << x;
    }
    const auto gradient = isp.gradient();
    for (std::size_t k = 0; k < gradient.size(); ++k)
        EXPECT_TRUE(std::isfinite(gradient[k])) << what << " " << k << " " << gradient[k];
}

TEST(Ppisp, ExtremesStayFinite) {
    std::mt19937 rng(5);
    std::uniform_real_distribution<float> u(-1, 1);
    const float magnitude[] = {0.1f, 1, 10, 100, 1e3f, 1e4f};
    for (int trial = 0; trial < 20000; ++trial) {
        Isp<float> isp;
        isp.w = trial % 3 + 1, isp.h = trial % 2 + 1;
        isp.raw = identity<float>();
        const auto any = [&] { return magnitude[rng() % 6] * u(rng); };
        if (rng() % 2) isp.raw[0] = rng() % 2 ? any() : (rng() % 2 ? 1e4f : -1e4f);
        for (int k = 1; k < 9; ++k) isp.raw[k] = trial % 5 ? any() : (rng() % 2 ? 1e4f : -1e4f);
        for (int k = 0; k < 15; ++k) isp.raw[9 + k] = k % 5 < 2 ? u(rng) : (rng() % 2 ? any() : 1e6f * u(rng));
        for (int k = 0; k < 12; ++k)
            isp.raw[24 + k] += rng() % 2 ? std::max(-200.0f, std::min(200.0f, any())) : (rng() % 2 ? 200.0f : -200.0f);
        for (int i = 0; i < isp.w * isp.h; ++i) {
            const auto colour = [&] {
                const float choices[] = {0, 1, 255, u(rng), std::abs(u(rng)), 1e-6f, 1e-20f, 1e-38f, 1e-42f, 0.999999f};
                return choices[rng() % 10];
            };
            isp.image.push_back({colour(), colour(), colour()});
            isp.weights.push_back({u(rng), u(rng), u(rng)});
        }
        expect_finite(isp, "trial " + std::to_string(trial));
        if (::testing::Test::HasFailure()) return;
    }
}

TEST(Ppisp, CentreAtTheEndsKeepsOneBranch) {
    Isp<float> isp;
    isp.raw = identity<float>();
    isp.image.assign(35, {0.0f, 0.5f, 1.0f}), isp.weights.assign(35, {1, 1, 1});
    for (const float raw : {-200.0f, -104.0f, -100.0f, -88.0f, -20.0f, 17.0f, 18.0f, 88.0f, 104.0f, 200.0f}) {
        for (int c = 0; c < 3; ++c)
            isp.raw[24 + 4 * c + 3] = raw, isp.raw[24 + 4 * c] = 2, isp.raw[24 + 4 * c + 1] = -1;
        expect_finite(isp, "centre " + std::to_string(raw));
        const Vec3<float> out = isp.correct()[17];
        EXPECT_EQ(out.x, 0);
        EXPECT_NEAR(out.z, 1, 1e-3) << "white arrives 7e-6 below 1, where the shoulder is steep";
        EXPECT_GT(out.y, 0.1);
    }
}

TEST(Ppisp, BlackStaysBlackWithoutGradientOfItsIntensity) {
    Isp<double> isp = random_isp(6, 1);
    for (Vec3<double>& p : isp.image) p = {0, 0, 0};
    for (const Vec3<double>& p : isp.correct()) EXPECT_EQ(dot(p, p), 0);
    for (const double g : isp.gradient()) EXPECT_EQ(g, 0);
}

TEST(Ppisp, NegativeColoursCountAsBlack) {
    Isp<double> isp = random_isp(7, 0.5), zero = isp;
    for (Vec3<double>& p : isp.image) p.y = -0.3;
    for (Vec3<double>& p : zero.image) p.y = 0;
    EXPECT_EQ(isp.loss(), zero.loss());
    const std::vector<double> gradient = isp.gradient();
    for (int i = 0; i < 35; ++i) EXPECT_EQ(gradient[kRaw + 3 * i + 1], 0);
}

TEST(Ppisp, NanIsNotHidden) {
    Isp<float> isp;
    isp.w = isp.h = 1;
    isp.raw = identity<float>();
    isp.image = {{std::nanf(""), 0.5f, 0.5f}};
    EXPECT_TRUE(std::isnan(isp.correct()[0].x));
}

/// Computes docs/math/ppisp.md#regularizers term by term.
double regularizer(const std::vector<double>& raw, int frames, int cameras) {
    const auto smooth_l1 = [](double x, double beta) {
        return std::abs(x) < beta ? x * x / (2 * beta) : std::abs(x) - beta / 2;
    };
    double mean[9] = {}, loss = 0;
    const double P[4][3] = {{0.0480542, -0.0043631, 0.0481283},
                            {0.0580570, -0.0179872, 0.0431061},
                            {0.0433336, -0.0180537, 0.0580500},
                            {0.0128369, -0.0034654, 0.0128158}};
    for (int f = 0; f < frames; ++f) {
        const double* r = &raw[9 * f];
        mean[0] += r[0] / frames;
        for (int k = 0; k < 4; ++k) {
            mean[1 + 2 * k] += (r[1 + 2 * k] * P[k][0] + r[2 + 2 * k] * P[k][1]) / frames;
            mean[2 + 2 * k] += (r[1 + 2 * k] * P[k][1] + r[2 + 2 * k] * P[k][2]) / frames;
        }
    }
    loss += smooth_l1(mean[0], 0.1);
    for (int k = 0; k < 8; ++k) loss += smooth_l1(mean[1 + k], 0.005) / 8;
    const auto variance = [](double a, double b, double c) {
        const double m = (a + b + c) / 3;
        return ((a - m) * (a - m) + (b - m) * (b - m) + (c - m) * (c - m)) / 3;
    };
    for (int camera = 0; camera < cameras; ++camera) {
        const double *v = &raw[9 * frames + 27 * camera], *r = v + 15;
        for (int c = 0; c < 3; ++c) {
            loss += 0.02 * (v[5 * c] * v[5 * c] + v[5 * c + 1] * v[5 * c + 1]) / (3 * cameras);
            for (int k = 2; k < 5; ++k) loss += 0.01 * std::max(v[5 * c + k], 0.0) / (9 * cameras);
        }
        for (int k = 0; k < 5; ++k) loss += 0.1 * variance(v[k], v[5 + k], v[10 + k]) / (5 * cameras);
        for (int k = 0; k < 4; ++k) loss += 0.1 * variance(r[k], r[4 + k], r[8 + k]) / (4 * cameras);
    }
    return loss;
}

TEST(Ppisp, RegularizerGradientMatchesFiniteDifferences) {
    std::mt19937 rng(8);
    std::uniform_real_distribution<double> u(-1, 1);
    for (const double size : {0.03, 0.3, 3.0}) {  // on both sides of the bends
        const int frames = 5, cameras = 2;
        std::vector<double> raw(9 * frames + 27 * cameras);
        for (double& x : raw) x = size * u(rng);
        double means[9] = {}, frame_gradient[9];
        for (int f = 0; f < frames; ++f)
            for (int k = 0; k < 9; ++k) means[k] += raw[9 * f + k] / frames;
        isp_frame_regularizer(means, frames, frame_gradient);
        for (std::size_t k = 0; k < raw.size(); ++k) {
            const int camera = (int(k) - 9 * frames) / 27;
            const double got = int(k) < 9 * frames ? frame_gradient[k % 9]
                                                   : isp_camera_regularizer(&raw[9 * frames + 27 * camera], cameras,
                                                                            (int(k) - 9 * frames) % 27);
            const double x = raw[k], h = 1e-5;
            raw[k] = x + h;
            const double up = regularizer(raw, frames, cameras);
            raw[k] = x - h;
            const double down = regularizer(raw, frames, cameras);
            raw[k] = x;
            EXPECT_NEAR(got, (up - down) / (2 * h), 1e-9) << k;
        }
    }
}

}  // namespace
}  // namespace gs
