// SPDX-License-Identifier: Apache-2.0
// The plan of a run with constraints: its words, its estimates of time and size, and what came of it.
#include "apps/gsapp/train/plan.h"

#include <gtest/gtest.h>
#include <filesystem>

#include "appearance/model_info.h"
#include "eval/experiments/tradeoff_search.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/export/ngsplat.h"
#include "lib/export/pack_scene.h"
#include "lib/export/splat_file.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/initialize.h"
#include "lib/model/ply.h"
#include "lib/scene/procedural.h"
#include "tests/core/temporary_folder.h"

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
    o.size_limit = parse_bytes("3MB", ""), o.size_of = SizeOf::kPly;
    return o;
}

TEST(Plan, IsEmptyWithoutConstraints) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o = resolve(o);
    EXPECT_TRUE(make_plan(o, scene_of_the_plan()).json.is_null());
    EXPECT_TRUE(make_plan(o, scene_of_the_plan()).lines.empty());
}

TEST(Plan, SaysWhatIsLimitedAndWhatCameOfIt) {
    TrainOptions o = three_megabytes();
    o.time_limit = parse_duration("20s", ""), o.cap_max = 24160;
    o = resolve(o);
    TrainingPlan plan = make_plan(o, scene_of_the_plan());
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
    o = resolve(o);
    std::int64_t pixels = 0;
    for (const View& view : scene_of_the_plan().train) pixels += view.camera.width * view.camera.height;
    const TrainingPlan plan = make_plan(o, scene_of_the_plan());
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
    o = resolve(o);
    EXPECT_FALSE(make_plan(o, scene_of_the_plan()).json["estimated_loss"].contains("length"));
    o = three_megabytes();
    o.target_psnr = 30;
    o = resolve(o);
    EXPECT_FALSE(make_plan(o, scene_of_the_plan()).json["estimated_loss"].contains("length")) << "the search decides";
}

TEST(Plan, ACapBelowTheSizeIsSaidBefore) {
    TrainOptions o = three_megabytes();
    o.cap_max = 1000;
    o = resolve(o);
    const TrainingPlan plan = make_plan(o, scene_of_the_plan());
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

TrainOptions run(std::int64_t iterations, std::int64_t cap_max, const std::string& appearance = "sh") {
    TrainOptions o;
    o.iterations = iterations, o.cap_max = cap_max, o.appearance = appearance;
    return o;
}

TEST(TimePlan, TriesWhatNothingIsKnownOf) {
    const TimePlan plan;
    EXPECT_FALSE(plan.seconds(run(1000, 1000)));
    EXPECT_TRUE(plan.fits(run(1000, 1000), 0.1));
}

TEST(TimePlan, ScalesTheNearestRunAndAddsWhatALaunchTakes) {
    TimePlan plan;
    plan.add(run(1000, 1000), 10, 12);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(1000, 1000)), 12);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(4000, 1000)), 42);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(4000, 10000)), 402);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(500, 1000)), 7);
    plan.add(run(4000, 10000), 90, 93);  // measured: far less than in proportion
    EXPECT_DOUBLE_EQ(*plan.seconds(run(4000, 10000)), 93);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(4000, 20000)), 183);
    EXPECT_TRUE(plan.fits(run(4000, 20000), 183));
    EXPECT_FALSE(plan.fits(run(4000, 20000), 182));
}

TEST(TimePlan, KnowsTheTimeOfRunsWithALimit) {
    TimePlan plan;
    TrainOptions limited = run(1000, 1000);
    limited.time_limit = parse_duration("20s", "");
    EXPECT_DOUBLE_EQ(*plan.seconds(limited), 20);
    plan.add(limited, 19, 25);
    EXPECT_DOUBLE_EQ(*plan.seconds(limited), 26);
    EXPECT_FALSE(plan.seconds(run(1000, 1000))) << "its length says nothing about a number of iterations";
}

TEST(TimePlan, PrefersTheAppearanceAmongRunsOfOneSize) {
    TimePlan plan;
    plan.add(run(1000, 1000, "none"), 5, std::nullopt);
    plan.add(run(1000, 1000, "sh"), 8, std::nullopt);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(2000, 1000, "none")), 10);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(2000, 1000, "sh")), 16);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(2000, 1000, "nasg")), 10) << "of equals the first";
}

// Files of limited size: what is planned against what is written.

TrainOptions options_of(const std::string& appearance, const std::string& limit, SizeOf of) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.appearance = appearance, o.named = {"appearance"};
    o.size_limit = parse_bytes(limit, ""), o.size_of = of;
    o.init_points = 5000;
    o = resolve(o);
    return o;
}

const Scene& scene() {
    static const Scene scene = [] {
        SceneOptions options;
        options.resolution = 16;
        return load_builtin_scene("diffuse", options);
    }();
    return scene;
}

Gaussians model_of(const TrainOptions& o, std::int64_t count) {
    InitOptions init = init_options(o);
    init.most_points = count;
    Gaussians model = initialize_gaussians(scene(), appearance_spec(o), init);
    model.active_degree = model.appearance.max_degree;
    return model;
}

class SizePlanOf : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, SizePlanOf, ::testing::ValuesIn(appearance_names()),
                         [](const auto& info) { return info.param; });

TEST_P(SizePlanOf, IsTheSizeOfTheFile) {
    const test::TemporaryFolder tmp;
    for (const std::int64_t count : {1, 2048, 2049}) {
        const TrainOptions web = options_of(GetParam(), "100MB", SizeOf::kWeb);
        const Gaussians model = model_of(web, count);
        ASSERT_EQ(model.count, count);
        PackedScene packed = pack_gaussians(model);
        packed.cameras.resize(scene().test.size());
        packed.trailer = std::string(1024, ' ');
        const auto scene_file = tmp.path() / "scene.ngsplat", ply_file = tmp.path() / "model.ply";
        write_ngsplat(scene_file, packed);
        EXPECT_EQ(plan_size(web, scene()).bytes(count), std::int64_t(std::filesystem::file_size(scene_file)));

        const TrainOptions ply = options_of(GetParam(), "100MB", SizeOf::kPly);
        write_ply(ply_file, model, {});
        const auto real = std::int64_t(std::filesystem::file_size(ply_file));
        EXPECT_GE(plan_size(ply, scene()).bytes(count), real);
        EXPECT_LE(plan_size(ply, scene()).bytes(count), real + 4096);
    }
}

TEST_P(SizePlanOf, TheMostFitsAndOneUnitMoreDoesNot) {
    for (const SizeOf of : {SizeOf::kWeb, SizeOf::kPly}) {
        const SizePlan plan = plan_size(options_of(GetParam(), "3MB", of), scene());
        EXPECT_LE(plan.bytes(plan.most_gaussians), 3000000);
        EXPECT_GT(plan.bytes(plan.most_gaussians + 1), 3000000);
    }
}

TEST(SizePlan, ASplatFileHasOneColourAndNoHeader) {
    TrainOptions o;
    o.source = "builtin:diffuse", o.size_limit = parse_bytes("1MB", ""), o.size_of = SizeOf::kSplat;
    o = resolve(o);
    EXPECT_EQ(o.appearance, "none");
    EXPECT_EQ(o.recipe, Recipe::kFrontier);
    EXPECT_EQ(plan_size(o, scene()).most_gaussians, 31250);
}

TEST(SizePlan, ASizeBelowTheSmallestFileIsRefusedWithThatSize) {
    for (const std::string limit : {"1KB", "0"}) {
        try {
            plan_size(options_of("sh", limit, SizeOf::kWeb), scene());
            FAIL() << limit;
        } catch (const UsageError& e) {
            EXPECT_NE(std::string(e.what()).find(limit + " is too small: the smallest web file of sh takes 11"),
                      std::string::npos)
                << e.what();
        }
    }
}

}  // namespace
}  // namespace gs
