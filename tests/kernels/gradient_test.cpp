// SPDX-License-Identifier: Apache-2.0
// Every analytic gradient of the renderer against central differences in double. The models one by one:
// every_model_test.cpp.
#include <gtest/gtest.h>

#include "appearance/none/none.h"
#include "tests/kernels/gradient_check.h"

namespace gs::test {
namespace {

TEST(RenderGradient, MatchesFiniteDifferencesForEveryParameter) {
    const auto camera = test_camera(33, 25);
    for (std::uint32_t seed = 1; seed <= 4; ++seed) {
        GradientCheck check;
        const auto s = random_gaussians(16, 3, seed);
        check.run<appearance::Sh>(seed > 2 ? antialiased(s) : s, camera, {0.2, 0.7, 0.4},
                                  random_weights(3 * 33 * 25, seed));
        EXPECT_EQ(check.checked, 16 * (11 + 3 + 45));
        std::printf("seed %u: worst relative error %.2e over %d parameters\n", seed, check.worst, check.checked);
    }
}

TEST(RenderGradient, MatchesForEachShDegreeAndActivation) {
    const auto camera = test_camera(20, 18);
    for (int degree = 0; degree <= 3; ++degree)
        for (const auto activation : {ColorActivation::kRelu, ColorActivation::kSoftplus, ColorActivation::kSigmoid,
                                      ColorActivation::kHardSigmoid}) {
            auto s = random_gaussians(6, degree, 7 + degree);
            s.appearance.activation = activation;
            GradientCheck check;
            check.run<appearance::Sh>(s, camera, {0, 0, 0}, random_weights(3 * 20 * 18, 5));
        }
}

TEST(RenderGradient, MatchesWithoutViewDependence) {
    const auto camera = test_camera(20, 18);
    GradientCheck check;
    check.run<appearance::None>(random_gaussians(8, 0, 3), camera, {1, 1, 1}, random_weights(3 * 20 * 18, 6));
}

TEST(RenderGradient, InactiveBandsGetExactlyZero) {
    const auto camera = test_camera(20, 18);
    auto s = random_gaussians(6, 3, 4);
    s.active_degree = 1;
    Pipeline<double, appearance::Sh> pipe;
    pipe.render(s, camera, {0, 0, 0});
    const auto g = pipe.gradients(s, random_weights(3 * 20 * 18, 6));
    double active = 0;
    for (std::int64_t i = 0; i < s.count; ++i)
        for (int k = 0; k < 45; ++k) {
            const double x = g[Group::kResidual].param[45 * i + k];
            if (k < 9)
                active += std::abs(x);
            else
                EXPECT_EQ(x, 0) << k;
        }
    EXPECT_GT(active, 0);
}

// docs/math/rasterizer.md#extremes, where the limit is a finite gradient.
TEST(RenderGradient, MatchesAtTheExtremes) {
    const auto camera = test_camera(33, 25);
    const auto weights = random_weights(3 * 33 * 25, 9);
    const auto position = [&](double depth, double u, double v) {
        const Vec3<double> p =
            camera.rotation.transposed_times(Vec3<double>{u * depth, v * depth, depth} - camera.translation);
        return std::array<double, 3>{p.x, p.y, p.z};
    };
    struct Case {
        const char* name;
        double depth, u, v;
        std::array<double, 3> log_scale;
        double raw_opacity;
        double tolerance;
    };
    const Case cases[] = {
        {"opaque: alpha close to 1", 4, 0, 0, {-1, -1, -1}, 12, 1e-6},
        {"saturated opacity", 4, 0, 0, {-1, -1, -1}, 50, 1e-6},
        {"needle", 4, 0.05, 0, {1, -9, -9}, 0, 1e-5},
        {"disc seen edge on", 4, 0, 0.1, {-0.5, -0.5, -20}, 0, 1e-6},
        {"vanishing size", 4, 0.01, 0.02, {-30, -30, -30}, 1, 1e-6},
        {"just behind the near plane", 0.2001, 0.1, 0.1, {-4, -4, -4}, 0, 1e-5},
        {"outside the Jacobian's clip in x", 2, 1.2, 0, {0.2, 0.2, 0.2}, 2, 1e-5},
        {"outside the Jacobian's clip in y", 2, 0, -1.2, {0.2, 0.2, 0.2}, 2, 1e-5},
        {"larger than the image", 4, 0.3, 0.2, {4, 4, 3}, 0, 1e-5},
    };
    for (const Case& c : cases) {
        SCOPED_TRACE(c.name);
        auto s = random_gaussians(3, 3, 11);
        const auto p = position(c.depth, c.u, c.v);
        for (int k = 0; k < 3; ++k) s[Group::kMean].param[k] = p[k], s[Group::kScale].param[k] = c.log_scale[k];
        s[Group::kOpacity].param[0] = c.raw_opacity;
        GradientCheck check;
        check.tolerance = c.tolerance;
        check.run<appearance::Sh>(s, camera, {0.1, 0.2, 0.3}, weights);
        check.run<appearance::Sh>(antialiased(s), camera, {0.1, 0.2, 0.3}, weights);
        s.antialiased = true;  // without a 3-D filter, as saved models are
        check.run<appearance::Sh>(s, camera, {0.1, 0.2, 0.3}, weights);
    }
}

TEST(RenderGradient, ColourPartOfTheMeanGradientIsTangential) {
    const auto camera = test_camera(20, 18);
    auto s = random_gaussians(5, 3, 21);
    const auto weights = random_weights(3 * 20 * 18, 2);
    Pipeline<double, appearance::Sh> pipe;
    pipe.render(s, camera, {0, 0, 0});
    const auto full = pipe.gradients(s, weights);
    auto frozen = s;  // base colours that show the same from this camera, no residual: same image, no direction term
    for (std::int64_t i = 0; i < s.count; ++i) {
        const double* m = &s[Group::kMean].param[3 * i];
        const auto d = view_direction(Vec3<double>{m[0], m[1], m[2]}, camera.position);
        const auto r = appearance::Sh::residual(&s[Group::kResidual].param[45 * i], d.unit, 3);
        double* b = &frozen[Group::kBase].param[3 * i];
        b[0] += r.x, b[1] += r.y, b[2] += r.z;
    }
    frozen.active_degree = 0;
    pipe.render(frozen, camera, {0, 0, 0});
    const auto geometry = pipe.gradients(frozen, weights);
    double norm = 0;
    for (std::int64_t i = 0; i < s.count; ++i) {
        Vec3<double> g;
        const double *a = &full[Group::kMean].param[3 * i], *b = &geometry[Group::kMean].param[3 * i],
                     *m = &s[Group::kMean].param[3 * i];
        g = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
        const auto d = view_direction(Vec3<double>{m[0], m[1], m[2]}, camera.position);
        EXPECT_NEAR(dot(g, d.unit), 0, 1e-10 * (1 + std::sqrt(dot(g, g))));
        norm += dot(g, g);
    }
    EXPECT_GT(norm, 0);
}

}  // namespace
}  // namespace gs::test
