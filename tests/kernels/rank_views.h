// SPDX-License-Identifier: Apache-2.0
// What tests of several ranks train: a random model with views and photographs, and comparisons of what comes of it.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "appearance/model_info.h"
#include "kernels/ranks/shard.h"
#include "kernels/state/adam_device.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/lenses.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {

inline constexpr int kRankWidth = 41, kRankHeight = 30, kViews = 4;
inline constexpr std::int64_t kRows = 211;  // no multiple of any number of ranks

/// Views of one random model, with random photographs.
struct RankViews {
    Gaussians model;
    std::vector<CameraParams<float>> cameras;
    std::vector<std::vector<float>> photographs;

    explicit RankViews(const ModelInfo& info, std::int64_t rows = kRows, std::int64_t num_residuals = -1) {
        model = cast<float>(random_gaussians(rows, 0, 5));
        model.appearance = {info.name, info.max_degree_limit, ColorActivation::kSigmoid};
        model.active_degree = info.max_degree_limit;
        std::mt19937 rng(6);
        std::normal_distribution<float> normal;
        auto& residuals = model[Group::kResidual];
        residuals.width = info.residual_width(info.max_degree_limit);
        residuals.param.resize(std::size_t(num_residuals < 0 ? rows : num_residuals) * residuals.width);
        for (float& x : residuals.param) x = 0.3f * normal(rng);
        model.shared.width = info.num_shared;
        for (int k = 0; k < info.num_shared; ++k) model.shared.param.push_back(0.3f * normal(rng));
        for (auto& group : model.groups)
            group.m.assign(group.param.size(), 0.0f), group.v.assign(group.param.size(), 0.0f);
        model.shared.m.assign(model.shared.param.size(), 0.0f), model.shared.v = model.shared.m;
        model.ppisp = identity_ppisp(kViews, 1);
        model.ppisp.m.assign(model.ppisp.size(), 0.0f), model.ppisp.v = model.ppisp.m;
        std::uniform_real_distribution<float> uniform;
        for (int k = 0; k < kViews; ++k) {
            cameras.push_back(cast<float>(test_camera(kRankWidth, kRankHeight)));
            cameras.back().translation.x += 0.3f * float(k);
            cameras.back().position = cameras.back().rotation.transposed_times(cameras.back().translation) * -1.0f;
            photographs.emplace_back(std::size_t(3 * kRankWidth * kRankHeight));
            for (float& x : photographs.back()) x = uniform(rng);
        }
    }
    /// Puts lenses before all cameras but the last: wide, of 360 degrees and drawn as by pinholes, and thin.
    RankViews through_lenses() && {
        const TestLens lenses[] = {test_lenses()[0], drawn_as_pinholes(equirectangular_lens()), test_lenses()[2]};
        static_assert(std::size(lenses) < kViews);
        for (std::size_t k = 0; k < std::size(lenses); ++k) {
            CameraParams<float> camera = cast<float>(lens_camera(lenses[k], kRankWidth, kRankHeight));
            camera.translation = cameras[k].translation, camera.position = cameras[k].position;
            cameras[k] = camera;
        }
        return std::move(*this);
    }

    /// Returns a description for messages of tests.
    std::string name() const {
        return std::to_string(model.num_residuals()) + " residuals" +
               (cameras[0].lens.is_pinhole() ? "" : ", through lenses");
    }
    TargetImage target(int view) const {
        return {kRankWidth, kRankHeight, 3, nullptr, photographs[std::size_t(view)].data(), nullptr, {view}};
    }
    TargetSource targets() const {
        return [this](StepRequest& r) { r.target = target(r.target.id.view); };
    }
    StepRequest step(std::size_t view) const {
        StepRequest r;
        r.camera = cameras[view];
        r.background = {0.2f, 0.1f, 0.3f};
        r.target = target(int(view));
        r.isp = {IspMode::kFrame, int(view), 0, 0};
        r.loss.lambda_dssim = 0.3f;
        r.rates.isp = 1e-3;
        for (double& rate : r.rates.groups) rate = 1e-3;
        r.rates.shared = 1e-3;
        return r;
    }
    std::vector<StepRequest> steps() const {
        std::vector<StepRequest> all;
        for (std::size_t k = 0; k < kViews; ++k) all.push_back(step(k));
        return all;
    }
};

/// Calls fn(a, b, name) for all parameters and moments of two models.
template <class Fn> void for_arrays(Gaussians& a, Gaussians& b, Fn&& fn) {
    for (int g = 0; g < kNumGroups; ++g) {
        const std::string name = kGroupNames[g];
        fn(a.groups[g].param, b.groups[g].param, name);
        fn(a.groups[g].m, b.groups[g].m, name + ", first moment");
        fn(a.groups[g].v, b.groups[g].v, name + ", second moment");
    }
    fn(a.shared.param, b.shared.param, "shared");
    fn(a.shared.m, b.shared.m, "shared, first moment");
    fn(a.ppisp.param, b.ppisp.param, "PPISP");
    fn(a.ppisp.m, b.ppisp.m, "PPISP, first moment");
    fn(a.gradient_sum, b.gradient_sum, "gradient statistic");
    fn(a.gradient_count, b.gradient_count, "views of the gradient statistic");
    fn(a.last_step, b.last_step, "last step");
}

/// Returns the largest difference of two arrays of one size, as a share of the largest value of `a`.
inline double largest_difference(const std::vector<float>& a, const std::vector<float>& b) {
    double largest = 0, difference = 0;
    for (std::size_t k = 0; k < a.size(); ++k) {
        largest = std::max(largest, double(std::abs(a[k])));
        difference = std::max(difference, double(std::abs(a[k] - b[k])));
    }
    return difference > 0 ? difference / largest : 0;
}

inline void expect_close(const std::vector<float>& a, const std::vector<float>& b, double tolerance,
                         const std::string& what) {
    ASSERT_EQ(a.size(), b.size()) << what;
    EXPECT_LE(largest_difference(a, b), tolerance) << what;
}

/// Returns the sum of what one plain step on each view makes of a model without moments.
inline Gaussians sum_of_steps(const Gaussians& model, const std::vector<StepRequest>& steps) {
    Gaussians sum;
    for (std::size_t k = 0; k < steps.size(); ++k) {
        const auto backend = make_cpu_backend(model.appearance);
        backend->upload(model);
        backend->step(steps[k]);
        Gaussians one = backend->download(true);
        if (k == 0) {
            sum = one;
            continue;
        }
        for_arrays(sum, one, [](auto& total, const auto& x, const std::string&) {
            for (std::size_t i = 0; i < total.size(); ++i) total[i] += x[i];
        });
    }
    return sum;
}

/// Returns the factor from summed first moments of plain steps on `views` views to their mean gradient.
inline float mean_of_moments(std::size_t views) { return 1 / float(1 - kAdamBeta1) / float(views); }

/// Returns the factor from the first moment after one step on `views` views to the gradient of that step.
inline float gradient_of_moment(std::size_t views) { return 1 / float(1 - std::pow(kAdamBeta1, double(views))); }

inline void expect_equal(Gaussians& a, Gaussians& b) {
    EXPECT_EQ(a.count, b.count);
    EXPECT_EQ(a.step, b.step);
    for_arrays(a, b, [](const auto& x, const auto& y, const std::string& what) { EXPECT_EQ(x, y) << what; });
}

/// Puts three opaque Gaussians before all cameras, and behind them as many whose colours are not finite, which no pixel
/// reaches. Returns the rows of the latter.
inline std::vector<std::int64_t> hide_broken_rows(RankViews& views) {
    const auto& camera = views.cameras[0];
    const std::vector<std::int64_t> broken{5, views.model.count / 2, views.model.count - 1};
    const auto place = [&](std::int64_t row, float depth, float log_scale) {
        const Vec3<float> mean = camera.position + camera.rotation.r2 * depth;
        float* const p = views.model[Group::kMean].param.data() + 3 * row;
        p[0] = mean.x, p[1] = mean.y, p[2] = mean.z;
        for (int k = 0; k < 3; ++k) views.model[Group::kScale].param[std::size_t(3 * row + k)] = log_scale;
        views.model[Group::kOpacity].param[std::size_t(row)] = 10;
    };
    for (std::int64_t wall = 0; wall < 3; ++wall) place(wall, 1, 2);
    for (const std::int64_t row : broken) {
        place(row, 6, -1);
        views.model[Group::kBase].param[std::size_t(3 * row)] = std::numeric_limits<float>::quiet_NaN();
    }
    return broken;
}

/// Takes two steps on all views of a model with hidden broken rows, and expects that the gradients of these are counted
/// and left out.
inline void expect_left_out_gradients(const RankViews& views, const std::vector<std::int64_t>& broken,
                                      Backend& backend) {
    backend.upload(views.model);
    for (int k = 0; k < 2; ++k) backend.step_on(views.steps());
    backend.synchronize();
    const StepStats stats = backend.take_stats();
    EXPECT_EQ(stats.consecutive_skips, 0);
    EXPECT_EQ(stats.num_nonfinite_gradients, 2 * std::int64_t(broken.size()));
    EXPECT_EQ(backend.take_stats().num_nonfinite_gradients, 0) << "they are counted once";
    const Gaussians after = backend.download(true);
    for (int g = 0; g < kNumGroups; ++g)
        for (const float m : after.groups[g].m) ASSERT_TRUE(std::isfinite(m)) << kGroupNames[g];
}

/// Takes a step on views of which one has a loss that is not finite, and expects that it changes no parameter.
inline void expect_skipped_step(const RankViews& views, Backend& backend) {
    backend.upload(views.model);
    backend.step_on(views.steps());
    EXPECT_EQ(backend.take_stats().consecutive_skips, 1);
    Gaussians before = views.model, after = backend.download(true);
    EXPECT_EQ(after.step, kViews) << "a skipped step counts";
    after.step = after.ppisp.step = 0;
    expect_equal(after, before);
}

/// Returns the model after three steps with noise, after each of which it is densified.
inline Gaussians train_with_noise(const RankViews& views, Backend& backend) {
    backend.upload(views.model);
    for (int k = 0; k < 3; ++k) {
        auto steps = views.steps();
        for (StepRequest& step : steps) step.rates.noise = 100, step.iteration = k;
        backend.step_on(steps);
        backend.densify({McmcParams{.cap = kRows + 20}, k, 42});
    }
    return backend.download(true);
}

/// Steps that devices begin before they know what has become of the one before: PPISP does not learn, and nothing
/// comes between them. One of them is skipped.
inline constexpr int kStepsInARow = 6, kSkipped = 2;

/// Returns the views of step `k`.
inline RankViews views_in_a_row(const RankViews& views, std::int64_t k) {
    RankViews copy = views;
    if (k == kSkipped)
        for (auto& photograph : copy.photographs) photograph[17] = std::nanf("");
    return copy;
}

/// Returns the model after these steps on the first `num_views` views; with `one_by_one` the host waits for each.
inline Gaussians train_in_a_row(const RankViews& views, Backend& backend, bool one_by_one = false,
                                int num_views = kViews) {
    backend.upload(views.model);
    for (int k = 0; k < kStepsInARow; ++k) {
        const RankViews lent = views_in_a_row(views, k);
        auto steps = lent.steps();
        steps.resize(std::size_t(num_views));
        for (StepRequest& step : steps) step.rates.noise = 100, step.iteration = k, step.rates.isp = 0;
        backend.step_on(steps);
        if (one_by_one) backend.synchronize();
    }
    backend.synchronize();
    const StepStats stats = backend.take_stats();
    EXPECT_EQ(stats.steps, kStepsInARow);
    EXPECT_EQ(stats.consecutive_skips, 0);
    EXPECT_TRUE(std::isfinite(stats.loss));
    return backend.download(true);
}

/// Brings the photographs of these steps to other ranks than 0.
inline TargetSource targets_in_a_row(const RankViews& views) {
    return [&views](StepRequest& request) {
        const auto kept = std::make_shared<const RankViews>(views_in_a_row(views, request.iteration));
        request.target = kept->target(request.target.id.view);
        request.pixels = kept;
    };
}

}  // namespace gs::test
