// SPDX-License-Identifier: Apache-2.0
// The plan of a run with constraints: its words, its estimates, and what came of it.
#include "apps/gsapp/train/plan.h"

#include <gtest/gtest.h>

#include "lib/core/options.h"
#include "lib/scene/procedural.h"

namespace gs {
namespace {

const Scene& scene_of_the_plan() {
    static const Scene scene = [] {
        SceneOptions options;
        options.resolution = 160;
        return load_builtin_scene("diffuse", options);
    }();
    return scene;
}

/// Returns options with 3 MB of PLY, which are 12,080 Gaussians.
TrainOptions three_megabytes() {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.appearance = "sh", o.named = {"appearance"};
    o.size_limit = "3MB", o.size_of = SizeOf::kPly;
    return o;
}

TEST(Plan, IsEmptyWithoutConstraints) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    validate(o);
    EXPECT_TRUE(make_plan(o, scene_of_the_plan()).json.is_null());
    EXPECT_TRUE(make_plan(o, scene_of_the_plan()).lines.empty());
}

TEST(Plan, SaysWhatIsLimitedAndWhatCameOfIt) {
    TrainOptions o = three_megabytes();
    o.time_limit = "20s", o.cap_max = 24160;
    validate(o);
    Plan plan = make_plan(o, scene_of_the_plan());
    ASSERT_EQ(plan.lines.size(), 3u);
    EXPECT_NE(plan.lines[0].find("20.0 s from the first step to the saved model"), std::string::npos);
    EXPECT_NE(plan.lines[0].find("iterations, by estimate about 0.8 dB below a training of any length"),
              std::string::npos)
        << plan.lines[0];
    EXPECT_NE(plan.lines[1].find("at most 3MB as ply: 12080 Gaussians of 248 bytes with sh, by estimate about 0.3 dB "
                                 "below 24160 Gaussians (--cap-max) if the scene has detail for so many"),
              std::string::npos)
        << plan.lines[1];
    TrainSummary summary;
    summary.num_gaussians = 6040, summary.limited_seconds = 19.5, summary.saving_seconds = 0.5;
    summary.iterations = std::int64_t(70 * scene_of_the_plan().train.size());
    note_outcome(plan, o, summary);
    EXPECT_EQ(plan.json["time"]["limit_seconds"], 20.0);
    EXPECT_EQ(plan.json["time"]["seconds"], 19.5);
    EXPECT_EQ(plan.json["size"]["bytes"], 6040 * 248 + 4096);
    EXPECT_EQ(plan.json["num_gaussians"], 6040);
    const auto& loss = plan.json["estimated_loss"];
    EXPECT_EQ(loss["length"]["final"], loss["length"]["planned"]) << "as many iterations as were wanted";
    EXPECT_NEAR(double(loss["count"]["planned"]), loss_of_count(1, 2), 1e-9);
    EXPECT_NEAR(double(loss["count"]["final"]), loss_of_count(1, 4), 1e-9);
}

TEST(Plan, ComparesWithNoMoreGaussiansThanTheImagesTell) {
    TrainOptions o = three_megabytes();
    o.cap_max = 1000000000;
    validate(o);
    std::int64_t pixels = 0;
    for (const View& view : scene_of_the_plan().train) pixels += view.camera.width * view.camera.height;
    const Plan plan = make_plan(o, scene_of_the_plan());
    EXPECT_EQ(plan.full_count, pixels / 20);
    EXPECT_NE(
        plan.lines[1].find(std::to_string(pixels / 20) + " Gaussians (one for every 20 pixels of the training images)"),
        std::string::npos)
        << plan.lines[1];
    Scene small = scene_of_the_plan();
    small.train.resize(1), small.train[0].camera.width = small.train[0].camera.height = 1;
    EXPECT_EQ(make_plan(o, small).full_count, 1);
}

TEST(Plan, EstimatesOnlyWhatWasMeasured) {
    TrainOptions o = three_megabytes();
    o.recipe = Recipe::kPaper;
    validate(o);
    EXPECT_FALSE(make_plan(o, scene_of_the_plan()).json["estimated_loss"].contains("length"));
    o = three_megabytes();
    o.target_psnr = 30;
    validate(o);
    EXPECT_FALSE(make_plan(o, scene_of_the_plan()).json["estimated_loss"].contains("length")) << "the search decides";
}

TEST(Plan, ACapBelowTheSizeIsSaidBefore) {
    TrainOptions o = three_megabytes();
    o.cap_max = 1000;
    validate(o);
    const Plan plan = make_plan(o, scene_of_the_plan());
    EXPECT_EQ(plan.json["size"]["most_gaussians"], 1000);
    EXPECT_NE(plan.lines[2].find("--cap-max ends there"), std::string::npos) << plan.lines[2];
}

TEST(Estimate, FallsWithLengthAndNumber) {
    double last = 1e300;
    for (const double rounds : {1e-4, 0.1, 1.0, 20.0, 70.0, 300.0, 1e6}) {
        EXPECT_LT(loss_of_length(rounds), last);
        EXPECT_GT(loss_of_length(rounds), 0);
        last = loss_of_length(rounds);
    }
    last = 1e300;
    for (const std::int64_t count : {1, 1000, 250000, 500000, 999999}) {
        EXPECT_LT(loss_of_count(count, 1000000), last);
        last = loss_of_count(count, 1000000);
    }
    EXPECT_EQ(loss_of_count(1000000, 1000000), 0);
    EXPECT_EQ(loss_of_count(2000000, 1000000), 0) << "a scene may begin with more than the cap";
}

TEST(Estimate, IsSaidAsExactlyAsItIsKnown) {
    EXPECT_EQ(about(0.04), "less than 0.1 dB");
    EXPECT_EQ(about(0.31), "about 0.3 dB");
    EXPECT_EQ(about(55), "more than 10 dB");
}

}  // namespace
}  // namespace gs
