// SPDX-License-Identifier: Apache-2.0
// What ranks do alike on every device. Knows no appearance by name, so that it runs on any registry.
#pragma once

#include <gtest/gtest.h>

#include <numeric>
#include <stdexcept>

#include "appearance/model_info.h"
#include "tests/kernels/rank_threads.h"
#include "tests/kernels/rank_views.h"

namespace gs::test {

/// Returns a model that has a residual and no shared weights.
inline const ModelInfo& some_model() {
    for (const ModelInfo* info : appearance_models())
        if (info->residual_width(info->max_degree_limit) > 0 && info->num_shared == 0) return *info;
    throw std::logic_error("no model with a residual");
}

/// `Device` makes engines: `make_engine(appearance, fixed_order)`. Its `kPicture` is how far pictures, and `kSums` how
/// far sums over them, may be from those of one rank; `skip()` skips the test if there is no such device.
template <class Device> class RanksOn : public ::testing::Test {
  protected:
    void SetUp() override { Device::skip(); }
    /// Calls use(backend) with a model that `size` ranks hold, and steps on all views.
    template <class Fn> void with(int size, const RankViews& views, Fn&& use, bool fixed_order = false) {
        SCOPED_TRACE(std::to_string(size) + " ranks");
        with_ranked_backend(size, kViews, views.targets(), use,
                            [&] { return Device::make_engine(views.model.appearance, fixed_order); });
    }
};
TYPED_TEST_SUITE_P(RanksOn);

TYPED_TEST_P(RanksOn, GiveBackTheModelThatTheyWereGiven) {
    for (const std::int64_t rows : {std::int64_t(0), std::int64_t(1), std::int64_t(3), kRows}) {
        for (const std::int64_t num_residuals : {std::int64_t(0), rows / 3, rows}) {
            RankViews views(some_model(), rows, num_residuals);
            for (auto& group : views.model.groups) std::iota(group.m.begin(), group.m.end(), 1.0f);
            SCOPED_TRACE(std::to_string(rows) + " rows, " + std::to_string(num_residuals) + " residuals");
            for (const int ranks : {1, 2, 5})
                this->with(ranks, views, [&](Backend& backend) {
                    backend.upload(views.model);
                    Gaussians after = backend.download(true);
                    expect_equal(views.model, after);
                    EXPECT_EQ(backend.count(), rows);
                    EXPECT_EQ(backend.num_residuals(), num_residuals);
                });
        }
    }
}

TYPED_TEST_P(RanksOn, RenderAndScoreAsOne) {
    for (const RankViews& views :
         {RankViews(some_model(), kRows, 90), RankViews(some_model(), kRows, 90).through_lenses()}) {
        SCOPED_TRACE(views.name());
        Backend plain(TypeParam::make_engine(views.model.appearance, false));
        plain.upload(views.model);
        std::vector<RenderRequest> requests(kViews);
        for (std::size_t k = 0; k < kViews; ++k) requests[k].camera = views.cameras[k];
        const StepSource step_on = [&](std::size_t view) { return views.step(view); };
        std::vector<RenderedImage> images(kViews);
        for (std::size_t k = 0; k < kViews; ++k) plain.render(requests[k], images[k]);
        const auto scores = plain.scores(requests);
        const ResidualScores residuals = plain.residual_scores(kViews, step_on);
        const double error = plain.half_squared_error(views.step(2));
        for (const int ranks : {1, 2, 3})
            this->with(ranks, views, [&](Backend& backend) {
                backend.upload(views.model);
                for (std::size_t k = 0; k < kViews; ++k) {
                    RenderedImage other;
                    backend.render(requests[k], other);
                    expect_close(images[k].rgb, other.rgb, TypeParam::kPicture, "picture");
                    expect_close(images[k].alpha, other.alpha, TypeParam::kPicture, "alpha");
                }
                expect_close(scores, backend.scores(requests), TypeParam::kSums, "scores");
                const ResidualScores found = backend.residual_scores(kViews, step_on);
                expect_close(residuals.worth, found.worth, 10 * TypeParam::kSums, "worth of residuals");
                expect_close(residuals.mean_base, found.mean_base, TypeParam::kSums, "mean bases");
                EXPECT_NEAR(backend.half_squared_error(views.step(2)), error, TypeParam::kSums * error);
            });
    }
}

TYPED_TEST_P(RanksOn, GrowToTheCapAndPruneTogether) {
    RankViews views(some_model(), kRows, 90);
    for (std::int64_t i = 0; i < kRows; i += 10) views.model[Group::kOpacity].param[i] = -20;
    std::vector<RenderRequest> requests(kViews);
    for (std::size_t k = 0; k < kViews; ++k) requests[k].camera = views.cameras[k];
    for (const int ranks : {1, 2, 3, 4})
        this->with(ranks, views, [&](Backend& backend) {
            backend.upload(views.model);
            McmcParams mcmc;
            mcmc.cap = kRows + 17;
            const DensifyStats stats = backend.densify({mcmc, 1, 42});
            EXPECT_EQ(stats.relocated, 22);
            EXPECT_EQ(stats.added, 10) << "5 % of all, rounded once";
            EXPECT_EQ(stats.count, backend.count());
            EXPECT_EQ(backend.count(), kRows + 10);
            EXPECT_EQ(backend.densify({mcmc, 2, 42}).count, kRows + 17);
            EXPECT_EQ(backend.densify({mcmc, 3, 42}).count, kRows + 17);
            const Gaussians after = backend.download(true);
            EXPECT_EQ(after.count, kRows + 17);
            EXPECT_EQ(std::int64_t(after[Group::kMean].param.size()), 3 * after.count);
            // What dead rows were relocated to is alive.
            for (const float opacity : after[Group::kOpacity].param) EXPECT_GT(opacity, -6);
            const std::int64_t removed = backend.prune_lowest_scores(requests, 0.4);
            EXPECT_EQ(backend.count(), kRows + 17 - removed);
            EXPECT_GT(removed, 0);
            backend.step_on(views.steps());
            EXPECT_TRUE(std::isfinite(backend.take_stats().loss));
        });
}

TYPED_TEST_P(RanksOn, TrainWhereSomeHaveNothing) {
    // More ranks than views and than rows: some project nothing, and some render nothing.
    const RankViews views(some_model(), 2, 1);
    for (const int ranks : {1, 5})
        this->with(ranks, views, [&](Backend& backend) {
            backend.upload(views.model);
            backend.step_on(views.steps());
            backend.densify({McmcParams{}, 1, 42});
            EXPECT_EQ(backend.count(), 3);
            backend.step_on({views.step(3)});  // fewer views than ranks
            backend.morton_sort();
            EXPECT_TRUE(std::isfinite(backend.take_stats().loss));
            EXPECT_EQ(backend.download(true).step, kViews + 1);
        });
}

TYPED_TEST_P(RanksOn, GatherTheGradientsOfCameras) {
    for (const RankViews& views :
         {RankViews(some_model(), kRows, 90), RankViews(some_model(), kRows, 90).through_lenses()}) {
        SCOPED_TRACE(views.name());
        std::vector<StepRequest> steps = views.steps();
        for (StepRequest& step : steps) step.gather_camera_gradient = true;
        std::vector<ViewCameraGradient> expected;
        for (const StepRequest& step : steps) {
            const auto cpu = make_cpu_backend(views.model.appearance);
            cpu->upload(views.model);
            cpu->step(step);
            expected.push_back(cpu->take_camera_gradients().at(0));
        }
        const auto expect_gradients = [&](const std::vector<ViewCameraGradient>& found, std::size_t first) {
            for (std::size_t k = 0; k < found.size(); ++k) {
                EXPECT_EQ(found[k].id, steps[first + k].target.id);
                const auto of = [](CameraGradient<double> gradient) {
                    std::vector<float> numbers;
                    gradient.for_each([&](int, double number) { numbers.push_back(float(number)); });
                    return numbers;
                };
                const std::vector<float> a = of(expected[first + k].gradient), b = of(found[k].gradient);
                expect_close({a.begin(), a.begin() + 6}, {b.begin(), b.begin() + 6}, TypeParam::kSums, "pose");
                expect_close({a.begin() + 6, a.end()}, {b.begin() + 6, b.end()}, TypeParam::kSums, "lens");
            }
        };
        for (std::size_t k = 0; k < kViews; ++k) {
            Backend plain(TypeParam::make_engine(views.model.appearance, false));
            plain.upload(views.model);
            plain.step(steps[k]);
            const auto found = plain.take_camera_gradients();
            EXPECT_EQ(found.size(), 1);
            expect_gradients(found, k);
            EXPECT_TRUE(plain.take_camera_gradients().empty());
            plain.step(views.step(k));
            EXPECT_TRUE(plain.take_camera_gradients().empty()) << "the step did not ask for it";
        }
        for (const int ranks : {1, 2, 3})
            this->with(ranks, views, [&](Backend& backend) {
                backend.upload(views.model);
                backend.step_on(steps);
                const auto found = backend.take_camera_gradients();
                EXPECT_EQ(found.size(), std::size_t(kViews));
                expect_gradients(found, 0);
                EXPECT_TRUE(backend.take_camera_gradients().empty());
            });
    }
}

TYPED_TEST_P(RanksOn, SkipAStepWhoseLossIsNotFinite) {
    RankViews views(some_model());
    views.photographs[2][17] = std::nanf("");
    for (const int ranks : {1, 3})
        this->with(ranks, views, [&](Backend& backend) { expect_skipped_step(views, backend); });
}

TYPED_TEST_P(RanksOn, CountTheGradientsThatTheyLeaveOut) {
    RankViews views(some_model());
    const auto broken = hide_broken_rows(views);
    for (const int ranks : {1, 3})
        this->with(ranks, views, [&](Backend& backend) { expect_left_out_gradients(views, broken, backend); });
}

TYPED_TEST_P(RanksOn, RepeatThemselvesToTheBit) {
    const RankViews views(some_model(), kRows, 90);
    Gaussians first;
    for (const bool again : {false, true})
        this->with(
            3, views,
            [&](Backend& backend) {
                Gaussians after = train_with_noise(views, backend);
                if (again)
                    expect_equal(first, after);
                else
                    first = after;
            },
            true);
}

REGISTER_TYPED_TEST_SUITE_P(RanksOn, GiveBackTheModelThatTheyWereGiven, RenderAndScoreAsOne,
                            GrowToTheCapAndPruneTogether, TrainWhereSomeHaveNothing, GatherTheGradientsOfCameras,
                            SkipAStepWhoseLossIsNotFinite, CountTheGradientsThatTheyLeaveOut, RepeatThemselvesToTheBit);

}  // namespace gs::test
