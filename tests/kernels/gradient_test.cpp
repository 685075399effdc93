// SPDX-License-Identifier: Apache-2.0
// Every analytic gradient of the renderer against central differences in double.
#include <gtest/gtest.h>

#include "appearance/model_info.h"
#include "tests/kernels/random_scene.h"

#include "appearance_types.inc"

namespace gs::test {
namespace {

/// Relative to the largest gradient of the same group: entries that cancel to nearly nothing carry its rounding.
struct GradientCheck {
    double tolerance = 1e-6;
    int checked = 0;
    double worst = 0;

    template <class Model>
    void run(GaussianState<double> s, const CameraParams<double>& camera, const Vec3<double>& background, const std::vector<double>& weights) {
        Pipeline<double, Model> pipe;
        pipe.render(s, camera, background);
        const GaussianState<double> analytic = pipe.gradients(s, weights);
        const auto check = [&](std::vector<double>& values, const std::vector<double>& expected, const char* name) {
            double scale = 0;
            for (double x : expected) scale = std::max(scale, std::abs(x));
            for (std::size_t k = 0; k < values.size(); ++k) {
                // A fragment that crosses alpha = 1/255 between the two renders is a jump of the image, not a slope:
                // another step size avoids it. A wrong gradient matches none.
                double error = 1e9;
                for (const double h : {1e-5, 2e-6, 4e-7}) {
                    const double x = values[k];
                    values[k] = x + h;
                    pipe.render(s, camera, background);
                    const double up = pipe.weighted_sum(weights);
                    values[k] = x - h;
                    pipe.render(s, camera, background);
                    const double down = pipe.weighted_sum(weights);
                    values[k] = x;
                    const double fd = (up - down) / (2 * h);
                    error = std::min(error, std::abs(fd - expected[k]) / std::max({std::abs(expected[k]), 1e-2 * scale, 1e-4}));
                    if (error <= tolerance) break;
                }
                EXPECT_LE(error, tolerance) << name << "[" << k << "] analytic " << expected[k];
                worst = std::max(worst, error);
                ++checked;
            }
        };
        for (int g = 0; g < kNumGroups; ++g) check(s.groups[g].param, analytic.groups[g].param, kGroupNames[g]);
        check(s.shared.param, analytic.shared.param, "shared");
        ::testing::Test::RecordProperty("worst_relative_error", std::to_string(worst));
    }
};

TEST(RenderGradient, MatchesFiniteDifferencesForEveryParameter) {
    const auto camera = test_camera(33, 25);
    for (std::uint32_t seed = 1; seed <= 3; ++seed) {
        GradientCheck check;
        check.run<appearance::Sh>(random_gaussians(16, 3, seed), camera, {0.2, 0.7, 0.4}, random_weights(3 * 33 * 25, seed));
        EXPECT_EQ(check.checked, 16 * (11 + 3 + 45));
        std::printf("seed %u: worst relative error %.2e over %d parameters\n", seed, check.worst, check.checked);
    }
}

template <class Model> class EveryModel : public ::testing::Test {};
using AllModels = ::testing::Types<GS_ALL_APPEARANCE_MODELS>;
TYPED_TEST_SUITE(EveryModel, AllModels);

TYPED_TEST(EveryModel, RendersWithMatchingGradients) {
    const auto camera = test_camera(20, 18);
    const ModelInfo& info = appearance_model(appearance_name(static_cast<const TypeParam*>(nullptr)));
    auto s = random_gaussians(6, 0, 31);
    s.appearance.model = info.name;
    s.appearance.max_degree = s.active_degree = info.max_degree_limit;
    auto& residuals = s[Group::kResidual];
    residuals.width = info.residual_width(info.max_degree_limit);
    std::mt19937 rng(32);
    std::normal_distribution<double> normal;
    residuals.param.resize(s.count * residuals.width);
    for (double& x : residuals.param) x = normal(rng);
    s.shared.width = info.num_shared;
    for (int k = 0; k < info.num_shared; ++k) s.shared.param.push_back(0.3 * normal(rng));
    GradientCheck check;
    check.run<TypeParam>(s, camera, {0.1, 0.5, 0.9}, random_weights(3 * 20 * 18, 33));
    EXPECT_EQ(check.checked, s.count * (14 + residuals.width) + info.num_shared);
}

TEST(RenderGradient, MatchesForEachShDegreeAndActivation) {
    const auto camera = test_camera(20, 18);
    for (int degree = 0; degree <= 3; ++degree)
        for (const auto activation : {ColorActivation::kRelu, ColorActivation::kSoftplus, ColorActivation::kSigmoid, ColorActivation::kHardSigmoid}) {
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

// The extremes list of the rasterizer spec, where the limit is a finite gradient.
TEST(RenderGradient, MatchesAtTheExtremes) {
    const auto camera = test_camera(33, 25);
    const auto weights = random_weights(3 * 33 * 25, 9);
    const auto position = [&](double depth, double u, double v) {
        const Vec3<double> p = camera.rotation.transposed_times(Vec3<double>{u * depth, v * depth, depth} - camera.translation);
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
    }
}

TEST(RenderGradient, ColourPartOfTheMeanGradientIsTangential) {
    const auto camera = test_camera(20, 18);
    auto s = random_gaussians(5, 3, 21);
    const auto weights = random_weights(3 * 20 * 18, 2);
    Pipeline<double, appearance::Sh> pipe;
    pipe.render(s, camera, {0, 0, 0});
    const auto full = pipe.gradients(s, weights);
    auto frozen = s; // base colours that show the same from this camera, no residual: same image, no direction term
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
        const double *a = &full[Group::kMean].param[3 * i], *b = &geometry[Group::kMean].param[3 * i], *m = &s[Group::kMean].param[3 * i];
        g = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
        const auto d = view_direction(Vec3<double>{m[0], m[1], m[2]}, camera.position);
        EXPECT_NEAR(dot(g, d.unit), 0, 1e-10 * (1 + std::sqrt(dot(g, g))));
        norm += dot(g, g);
    }
    EXPECT_GT(norm, 0);
}

}  // namespace
}  // namespace gs::test
