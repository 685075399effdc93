// SPDX-License-Identifier: Apache-2.0
// What every appearance model must satisfy, whatever it computes (docs/math/appearance.md#conformance).
#include <gtest/gtest.h>

#include <random>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "tests/kernels/backends.h"

#include "appearance_types.inc"

namespace gs {
namespace {

using AllModels = ::testing::Types<GS_ALL_APPEARANCE_MODELS>;

template <class Model> class Conformance : public ::testing::Test {
  protected:
    const ModelInfo& info = appearance_model(appearance_name(static_cast<const Model*>(nullptr)));
    const int max_degree = info.max_degree_limit;
    std::mt19937 rng{11};
    std::normal_distribution<double> normal;

    Vec3<double> vector() { return {normal(rng), normal(rng), normal(rng)}; }
    Vec3<double> direction() {
        const Vec3<double> v = vector();
        return v * (1 / std::sqrt(dot(v, v)));
    }
    /// Returns random parameters of a Gaussian, then shared weights, at `scale` times their usual size.
    std::vector<double> parameters(double scale = 1) {
        std::vector<double> p(kAll);
        for (int k = 0; k < kAll; ++k) p[k] = (k < Model::kMaxResidual ? scale : 0.3 * scale) * normal(rng);
        return p;
    }
    static constexpr int kAll = Model::kMaxResidual + kNumSharedOf<Model>;
    template <class T> static Vec3<T> residual(const T* p, const Vec3<T>& d, int degree) {
        return model_residual<Model>(p + Model::kMaxResidual, p, d, degree);
    }
    /// Writes gradients to `dp`, which the caller has zeroed.
    template <class T>
    static void residual_backward(const T* p, const Vec3<T>& d, int degree, const Vec3<T>& g, T* dp, Vec3<T>& dd) {
        model_residual_backward<Model>(p + Model::kMaxResidual, p, d, degree, g, dp, dd, dp + Model::kMaxResidual);
    }
};
TYPED_TEST_SUITE(Conformance, AllModels);

TYPED_TEST(Conformance, BackwardMatchesFiniteDifferences) {
    if (!TypeParam::kDirectional) GTEST_SKIP() << "no residual";
    double worst = 0;
    for (int trial = 0; trial < 200; ++trial) {
        auto p = this->parameters();
        const Vec3<double> d = this->direction(), g = this->vector();
        const int degree = 1 + trial % this->max_degree;
        std::vector<double> dp(p.size());
        Vec3<double> dd;
        this->residual_backward(p.data(), d, degree, g, dp.data(), dd);
        const double h = 1e-6;
        for (std::size_t k = 0; k < p.size(); ++k) {
            const double x = p[k];
            p[k] = x + h;
            const double up = dot(this->residual(p.data(), d, degree), g);
            p[k] = x - h;
            const double down = dot(this->residual(p.data(), d, degree), g);
            p[k] = x;
            worst = std::max(worst, std::abs((up - down) / (2 * h) - dp[k]) / (std::abs(dp[k]) + 1e-2));
        }
        // Direction: along two tangents; the radial part of dd is projected out by direction_pullback.
        const Vec3<double> v = this->vector(), t = v - d * dot(v, d);
        const auto at = [&](double s) {
            const Vec3<double> e = d + t * s;
            return dot(this->residual(p.data(), e * (1 / std::sqrt(dot(e, e))), degree), g);
        };
        const double slope = dot(dd, t);
        worst = std::max(worst, std::abs((at(h) - at(-h)) / (2 * h) - slope) / (std::abs(slope) + 1e-2));
    }
    EXPECT_LT(worst, 1e-6);
}

TYPED_TEST(Conformance, InactiveParametersShowNothingAndLearnNothing) {
    for (int degree = 0; degree <= this->max_degree; ++degree) {
        const std::size_t active = this->info.residual_width(degree);
        auto p = this->parameters();
        p.resize(p.size() + 1);  // a valid pointer for models without parameters
        auto q = p;
        for (std::size_t k = active; k < TypeParam::kMaxResidual; ++k) q[k] = std::nan("");
        const Vec3<double> d = this->direction(), r = this->residual(p.data(), d, degree),
                           other = this->residual(q.data(), d, degree);
        EXPECT_LT(dot(r - other, r - other), 1e-28) << "inactive parameters are not read";
        std::vector<double> dp(p.size(), 0);
        Vec3<double> dd{7, 7, 7};
        this->residual_backward(p.data(), d, degree, {1, 1, 1}, dp.data(), dd);
        for (std::size_t k = active; k < TypeParam::kMaxResidual; ++k) EXPECT_EQ(dp[k], 0);
        if (degree > 0) continue;
        EXPECT_EQ(dot(r, r), 0);
        EXPECT_EQ(dot(dd, dd), 0);
    }
}

TYPED_TEST(Conformance, TheInitialModelShowsItsBaseColor) {
    EXPECT_EQ(this->info.residual_width(this->max_degree), TypeParam::kMaxResidual);
    for (int degree = 0; degree <= this->max_degree; ++degree) {
        std::vector<float> row(TypeParam::kMaxResidual + 1, 9.0f);
        this->info.init_residual(degree, row.data());
        for (std::size_t k = this->info.residual_width(degree); k < row.size(); ++k)
            EXPECT_EQ(row[k], 9.0f) << "beyond the row";
        ASSERT_EQ(this->info.num_shared, kNumSharedOf<TypeParam>);
        std::vector<float> all(this->kAll + 1);
        std::copy(row.begin(), row.end() - 1, all.begin());
        if (this->info.num_shared) this->info.init_shared(3, all.data() + TypeParam::kMaxResidual);
        const std::vector<double> p(all.begin(), all.end());
        const Vec3<double> r = this->residual(p.data(), this->direction(), std::min(this->info.initial_degree, degree));
        EXPECT_EQ(dot(r, r), 0);
    }
}

TYPED_TEST(Conformance, FloatFollowsDouble) {
    if (!TypeParam::kDirectional) GTEST_SKIP() << "no residual";
    for (int trial = 0; trial < 200; ++trial) {
        auto p = this->parameters();
        const std::vector<float> q(p.begin(), p.end());
        p.assign(q.begin(), q.end());  // the same inputs: what is compared is the computation
        const Vec3<double> e = this->direction(), h = this->vector();
        const Vec3<float> df{float(e.x), float(e.y), float(e.z)}, gf{float(h.x), float(h.y), float(h.z)};
        const Vec3<double> d{df.x, df.y, df.z}, g{gf.x, gf.y, gf.z};
        const auto expect_near = [](const Vec3<double>& a, const Vec3<float>& b, double relative) {
            const double tolerance = 1e-5 + relative * std::sqrt(dot(a, a));
            EXPECT_NEAR(a.x, b.x, tolerance);
            EXPECT_NEAR(a.y, b.y, tolerance);
            EXPECT_NEAR(a.z, b.z, tolerance);
        };
        // Below 1 the absolute bound is the tighter one; a lobe's density is unbounded.
        expect_near(this->residual(p.data(), d, this->max_degree), this->residual(q.data(), df, this->max_degree),
                    1e-5);
        std::vector<double> dp(p.size());
        std::vector<float> dq(p.size());
        Vec3<double> dd;
        Vec3<float> ddf;
        this->residual_backward(p.data(), d, this->max_degree, g, dp.data(), dd);
        this->residual_backward(q.data(), df, this->max_degree, gf, dq.data(), ddf);
        for (std::size_t k = 0; k < p.size(); ++k) EXPECT_NEAR(dp[k], dq[k], 1e-4 * std::abs(dp[k]) + 1e-6) << k;
        expect_near(dd, ddf, 1e-4);
    }
}

// Values of all parameters at once; tests/eval/bench/stability_test.cpp sweeps them one kind at a time.
TYPED_TEST(Conformance, GradientsAtTheExtremesAreTheRightLimitOrZero) {
    for (const double scale : {1e-30, 1e-6, 1.0, 1e3, 1e10, 1e30}) {
        for (int trial = 0; trial < 50; ++trial) {
            auto p = this->parameters(scale);
            for (int k = TypeParam::kMaxResidual; k < this->kAll; ++k)
                p[k] = std::clamp(p[k], -kLargestSharedWeight, kLargestSharedWeight);  // as the optimizer does
            p.resize(p.size() + 1);
            const std::vector<float> q(p.begin(), p.end());
            p.assign(q.begin(), q.end());
            std::vector<float> dq(q.size());
            std::vector<double> dp(p.size());
            const Vec3<float> axes[] = {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}};
            const Vec3<float> axis = axes[trial % 3];
            Vec3<float> dd;
            Vec3<double> wide_dd;
            const Vec3<float> r = this->residual(q.data(), axis, this->max_degree);
            this->residual_backward(q.data(), axis, this->max_degree, {1, 1, 1}, dq.data(), dd);
            this->residual_backward(p.data(), {axis.x, axis.y, axis.z}, this->max_degree, {1, 1, 1}, dp.data(),
                                    wide_dd);
            EXPECT_TRUE(std::isfinite(r.x + r.y + r.z + dd.x + dd.y + dd.z));
            double largest = 0;
            for (const double g : dp) largest = std::max(largest, std::abs(g));
            for (int k = 0; k < this->kAll; ++k) {
                EXPECT_TRUE(std::isfinite(dq[k]));
                // What is below the rounding of the largest gradient may have any sign; all of it may be below float's
                // range.
                if (std::abs(dp[k]) > 1e-5 * largest && std::abs(dp[k]) > 1e-30) {
                    EXPECT_GE(double(dq[k]) * dp[k], 0)
                        << "scale " << scale << ", column " << k << ": " << dq[k] << " for " << dp[k];
                }
            }
        }
    }
}

TEST(Contract, ViewDirectionPullbackIsTangentialAndScales) {
    const Vec3<double> mean{1, 2, 3}, camera{0.5, -1, 0.2}, g{0.3, -0.7, 0.2};
    const auto d = view_direction(mean, camera);
    const Vec3<double> p = direction_pullback(d, g);
    EXPECT_NEAR(dot(p, d.unit), 0, 1e-15);
    const auto twice = view_direction(camera + (mean - camera) * 2.0, camera);
    const Vec3<double> q = direction_pullback(twice, g);
    EXPECT_NEAR(q.x, p.x / 2, 1e-15);
    // On the camera centre the direction is undefined: a fixed one, and no gradient instead of one times 1e12.
    const auto none = view_direction(camera, camera);
    EXPECT_EQ(none.unit.z, 1);
    EXPECT_EQ(dot(direction_pullback(none, g), g), 0);
}

TEST(Contract, ColourActivationsMatchTheTable) {
    struct Row {
        double y, relu, softplus, softplus_slope, sigmoid, sigmoid_slope, hard;
    };
    for (const Row& r : {Row{-10, 0, 5.521e-43, 5.521e-42, 4.24835e-18, 1.69934e-17, 0},
                         {-1.5, 0, 4.53988992e-6, 4.53978687e-5, 0.00247262316, 0.00986603717, 0},
                         {-0.25, 0.25, 0.257888973, 0.92414182, 0.268941421, 0.786447733, 0.25},
                         {0, 0.5, 0.500671535, 0.993307149, 0.5, 1, 0.5},
                         {0.25, 0.75, 0.750055293, 0.999447221, 0.731058579, 0.786447733, 0.75},
                         {2, 2.5, 2.5, 1, 0.99966465, 0.00134095, 1}}) {
        EXPECT_NEAR(color_activation(ColorActivation::kRelu, r.y), r.relu, 1e-9);
        EXPECT_NEAR(color_activation(ColorActivation::kSoftplus, r.y), r.softplus, 1e-4 * r.softplus);
        EXPECT_NEAR(color_activation_derivative(ColorActivation::kSoftplus, r.y), r.softplus_slope,
                    1e-4 * r.softplus_slope);
        EXPECT_NEAR(color_activation(ColorActivation::kSigmoid, r.y), r.sigmoid, 1e-5 * r.sigmoid);
        EXPECT_NEAR(color_activation_derivative(ColorActivation::kSigmoid, r.y), r.sigmoid_slope,
                    1e-5 * r.sigmoid_slope);
        EXPECT_NEAR(color_activation(ColorActivation::kHardSigmoid, r.y), r.hard, 1e-9);
    }
    // Saturated in float, the slope is still the limit and not zero.
    EXPECT_GT(color_activation_derivative(ColorActivation::kSigmoid, 5.0f), 0);
    for (const auto kind : {ColorActivation::kRelu, ColorActivation::kSoftplus}) {
        EXPECT_EQ(color_activation(kind, 3e38f), float(kLargestColor))
            << "colours whose squares overflow end every step";
        EXPECT_EQ(color_activation_derivative(kind, 3e38f), 1) << "and come back";
    }
    EXPECT_TRUE(std::isnan(color_activation(ColorActivation::kRelu, std::nanf("")))) << "NaN must not be hidden";
    for (const auto kind : {ColorActivation::kRelu, ColorActivation::kSoftplus, ColorActivation::kSigmoid,
                            ColorActivation::kHardSigmoid}) {
        for (const double c : {0.0, 1.0 / 255, 0.25, 0.5, 1.0}) {
            const double y = inverse_color_activation(kind, c), kept = std::clamp(c, 0.5 / 255, 1 - 0.5 / 255);
            EXPECT_NEAR(color_activation(kind, y), kept, 1e-9);
            EXPECT_GT(color_activation_derivative(kind, y), 1e-4) << "no initial colour starts with a dead gradient";
        }
    }
}

TEST(Registry, ListsModelsAndRejectsUnknownOnes) {
    ASSERT_FALSE(appearance_models().empty());
    for (const ModelInfo* m : appearance_models()) {
        EXPECT_EQ(&appearance_model(m->name), m);
        EXPECT_FALSE(m->summary.empty());
        AppearanceSpec spec;
        spec.model = m->name;
        EXPECT_NE(make_cpu_backend(spec), nullptr);
        const int width = m->residual_width(m->default_max_degree);
        std::vector<float> row(width, 9.0f);
        m->init_residual(m->default_max_degree, row.data());
        for (float x : row) EXPECT_TRUE(std::isfinite(x));
        EXPECT_LE(m->default_max_degree, m->max_degree_limit);
        EXPECT_LE(m->initial_degree, m->max_degree_limit);
        const std::size_t columns = m->rates(m->default_max_degree, {}).residual.size();
        EXPECT_TRUE(width == 0 || columns == 1 || columns == std::size_t(width));
        EXPECT_GT(m->rates(m->default_max_degree, {}).base.at(1), 0);
    }
    EXPECT_THROW(appearance_model("shh"), UsageError);
}

}  // namespace
}  // namespace gs
