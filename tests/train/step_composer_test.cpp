// SPDX-License-Identifier: Apache-2.0
// What the options of a run become in the request of a step.
#include "lib/train/step_composer.h"

#include <gtest/gtest.h>

#include <cmath>

#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/timeline.h"

namespace gs {
namespace {

Scene two_views() {
    Scene scene;
    scene.train.resize(2);
    for (View& view : scene.train) view.camera.width = 8, view.camera.height = 6;
    return scene;
}

StepRequest composed(TrainOptions options, int factor = 1) {
    options.source = "x";
    options = resolve(options);
    const Scene scene = two_views();
    const StepComposer composer(options, appearance_spec(options), scene, nullptr);
    return composer.compose({.index = 1, .factor = factor}, moment_at(options, 0));
}

TEST(StepComposer, TakesTheLossOfTheOptions) {
    TrainOptions options;
    options.lambda_dssim = 0.4, options.opacity_reg = 0.5, options.scale_reg = 0.6;
    const StepRequest mcmc = composed(options);
    EXPECT_EQ(mcmc.loss.lambda_dssim, 0.4f);
    EXPECT_EQ(mcmc.loss.opacity_reg, 0.5f);
    EXPECT_EQ(mcmc.loss.scale_reg, 0.6f);
    EXPECT_FALSE(mcmc.gather_gradient_stats);
    options.strategy = Strategy::kAdc;
    const StepRequest adc = composed(options);
    EXPECT_EQ(adc.loss.lambda_dssim, 0.4f);
    EXPECT_EQ(adc.loss.opacity_reg + adc.loss.scale_reg, 0) << "regularisers are of MCMC";
    EXPECT_TRUE(adc.gather_gradient_stats);
}

TEST(StepComposer, TakesSeedAndMoversOfTheOptions) {
    TrainOptions options;
    options.seed = 7;
    EXPECT_EQ(composed(options).seed, 7u);
    EXPECT_TRUE(composed(options).only_visible);
    options.adam = Movers::kAll;
    EXPECT_FALSE(composed(options).only_visible);
}

TEST(StepComposer, NamesTheImageAndReducesTheCamera) {
    const StepRequest whole = composed({}), reduced = composed({}, 2);
    EXPECT_EQ(whole.target.id, (ImageId{1, 1}));
    EXPECT_EQ(reduced.target.id, (ImageId{1, 2}));
    EXPECT_EQ(whole.camera.width, 8);
    EXPECT_EQ(reduced.camera.width, 4);
    EXPECT_EQ(whole.isp.frame, 1) << "without a correction of the run each view has its own values";
}

TEST(StepComposer, DrawsAQuarterOfTheStepsThroughALensAsPinholesDo) {
    TrainOptions options;
    options.source = "x";
    options = resolve(options);
    Scene scene = two_views();
    scene.train[1].camera.model = CameraModel::kSimpleFisheye;
    const StepComposer composer(options, appearance_spec(options), scene, nullptr);
    const auto as_pinholes = [&](int iteration) {
        return composer.compose({.index = 1}, moment_at(options, iteration)).camera.lens.as_pinholes;
    };
    int count = 0;
    for (int i = 0; i < 400; ++i) {
        count += as_pinholes(i);
        EXPECT_EQ(as_pinholes(i), as_pinholes(i)) << "the same when a run is resumed";
    }
    EXPECT_NEAR(count, 100, 40);
}

TEST(StepComposer, AStepOnSeveralViewsHasTheRatesOfTheFirstTimesAPowerOfTheirNumber) {
    std::vector<StepRequest> views(4);
    for (StepRequest& view : views) view.rates.groups[0] = 1, view.rates.isp = 2;
    StepComposer::combine(views);
    const double factor = std::pow(4, 0.6);
    EXPECT_NEAR(views[0].rates.groups[0], factor, 1e-12);
    for (const StepRequest& view : views) EXPECT_NEAR(view.rates.isp, 2 * factor, 1e-12);
}

}  // namespace
}  // namespace gs
