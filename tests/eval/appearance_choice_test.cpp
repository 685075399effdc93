// SPDX-License-Identifier: Apache-2.0
#include "eval/appearance_choice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "eval/find_appearance.h"
#include "lib/core/options.h"
#include "lib/train/rehearsal.h"
#include "lib/train/scene_options.h"

namespace gs {
namespace {

/// model, bytes, seconds, psnr, train_psnr, error, aligned_error
const AppearanceTrial kNone{"none", 12, 1, 25, 27, 0.004, 0.0036};

TEST(AppearanceChoice, KeepsTheSmallestWithinTheTolerance) {
    const std::vector<AppearanceTrial> trials = {kNone, {"small", 44, 3, 26.91, 28, 0.002, 0.002}, {"large", 200, 2, 27, 29, 0.002, 0.002}};
    EXPECT_EQ(choose_appearance(trials, 0.1).chosen, 1u);
    EXPECT_EQ(choose_appearance(trials, 0.05).chosen, 2u);
    EXPECT_EQ(choose_appearance(trials, 2).chosen, 0u);
    EXPECT_EQ(choose_appearance(trials, 2).best, 2u);
}

TEST(AppearanceChoice, DecidesBetweenEqualBytesByTime) {
    const std::vector<AppearanceTrial> trials = {kNone, {"slow", 44, 3, 27, 28, 0.002, 0.002}, {"fast", 44, 2, 26.95, 28, 0.002, 0.002}};
    EXPECT_EQ(choose_appearance(trials, 0.1).chosen, 2u);
    EXPECT_EQ(choose_appearance(trials, 0).chosen, 0u + 1u);
}

TEST(AppearanceChoice, PassesOverTrialsThatFailed) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const AppearanceTrial failed{"failed", 10, 1, nan, nan, nan, nan};
    EXPECT_EQ(choose_appearance({kNone, failed}, 0.1).chosen, 0u);
    EXPECT_EQ(choose_appearance({failed}, 0.1).chosen, 0u);
    EXPECT_EQ(choose_appearance({failed, kNone}, 0.1).chosen, 1u);
}

TEST(AppearanceChoice, SharesOfTheErrorAddUpToOne) {
    const AppearanceChoice c = choose_appearance({kNone, {"model", 44, 1, 27, 29, 0.001, 0.0008}}, 0.1);
    EXPECT_DOUBLE_EQ(c.direction, 0.75);
    EXPECT_DOUBLE_EQ(c.neither, 0.2);
    EXPECT_NEAR(c.photometric, 0.05, 1e-12);
    EXPECT_EQ(c.remainder, Remainder::kReflectance);
    const AppearanceChoice alone = choose_appearance({kNone}, 0.1);
    EXPECT_DOUBLE_EQ(alone.direction, 0);
    EXPECT_NEAR(alone.photometric, 0.1, 1e-12);
    EXPECT_EQ(alone.remainder, Remainder::kUnresolved);
}

TEST(AppearanceChoice, TellsInconsistencyAndExposureFromReflectance) {
    EXPECT_EQ(choose_appearance({kNone, {"model", 44, 1, 25.2, 29, 0.0038, 0.0036}}, 0.1).remainder, Remainder::kInconsistency);
    AppearanceTrial exposed = kNone;
    exposed.aligned_error = 0.0005;
    EXPECT_EQ(choose_appearance({exposed}, 0.1).remainder, Remainder::kPhotometric);
}

TEST(FindAppearance, ChoosesFromHeldOutTrainingViews) {
    TrainOptions options;
    options.source = "builtin:diffuse";
    options.resolution = 32;
    options.iterations = 200;
    options.device = "cpu";
    validate(options);
    Scene scene = load_scene(scene_options(options));
    const AppearanceReport report = find_appearance(options, scene);
    EXPECT_EQ(report.lines.size(), 5u);
    EXPECT_EQ(report.json.at("model"), report.model);
    EXPECT_EQ(report.json.at("warm_up_iterations"), 20);
    EXPECT_EQ(report.json.at("trials").at(0).at("model"), "none");
    EXPECT_TRUE(std::isfinite(report.json.at("trials").at(0).at("PSNR").get<double>()));
    scene.train.resize(7);
    EXPECT_EQ(find_appearance(options, scene).model, "none") << "no view can be held out";
}

TEST(Rehearsal, AStretchThatTakesTooLongHasNoResult) {
    TrainOptions options;
    options.source = "builtin:diffuse";
    options.resolution = 16;
    options.appearance = "none";
    options.device = "cpu";
    validate(options);
    const Scene scene = load_scene(scene_options(options));
    Rehearsal rehearsal(options, scene);
    const Gaussians begun = rehearsal.begin(2).backend->download(false);
    EXPECT_FALSE(rehearsal.go_on(begun, begun.appearance, 1000000000, 0.05));
    EXPECT_TRUE(rehearsal.go_on(begun, begun.appearance, 2, 1e9));
}

}  // namespace
}  // namespace gs
