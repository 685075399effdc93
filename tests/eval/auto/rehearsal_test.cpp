// SPDX-License-Identifier: Apache-2.0
// Which parts a run has: the rules, and the measurements that they follow from.
#include "eval/auto/rehearsal.h"

#include <gtest/gtest.h>

#include <random>

#include "lib/core/options.h"
#include "lib/scene/procedural.h"
#include "lib/scene/scene.h"
#include "lib/train/pose_learner.h"

namespace gs {
namespace {

PartTrial made_up(Part part, const std::vector<double>& psnr_gains, const std::vector<double>& ssim_gains = {}) {
    PartTrial trial{.part = part};
    for (const double gain : psnr_gains) trial.without.psnr.push_back(25), trial.with.psnr.push_back(25 + gain);
    for (const double gain : ssim_gains) trial.without.ssim.push_back(0.9), trial.with.ssim.push_back(0.9 + gain);
    return trial;
}

TEST(Rehearsal, LearnsCamerasForAClearGainOnly) {
    const auto decided = [](const std::vector<double>& ssim_gains, double psnr_gain) {
        return decide(made_up(Part::kCameras, {psnr_gain, psnr_gain, psnr_gain}, ssim_gains));
    };
    const PartDecision clear = decided({0.01, 0.012, 0.008}, 0.4);
    EXPECT_TRUE(clear.on);
    EXPECT_NEAR(clear.gain, 0.1, 1e-9) << "of the 0.1 that SSIM lacks";
    EXPECT_NEAR(clear.error, 0.011547, 1e-6);
    EXPECT_NEAR(clear.decibels, 0.4, 1e-9);
    EXPECT_EQ(clear.reason.substr(0, 3), "on:") << clear.reason;
    EXPECT_FALSE(decided({0.002, 0.0022, 0.0018}, 0.4).on) << "small";
    EXPECT_FALSE(decided({0.04, -0.02, 0.01}, 0.4).on) << "uncertain";
    EXPECT_FALSE(decided({0.01, 0.012, 0.008}, -0.1).on) << "against PSNR";
    EXPECT_FALSE(decided({-0.01, -0.012, -0.008}, -0.4).on);
}

TEST(Rehearsal, CorrectsColoursIfHeldOutViewsGain) {
    const PartDecision clear = decide(made_up(Part::kPpisp, {0.3, 0.5, 0.1}));
    EXPECT_TRUE(clear.on);
    EXPECT_NEAR(clear.gain, 0.3, 1e-9);
    EXPECT_NEAR(clear.error, 0.115470, 1e-6);
    EXPECT_TRUE(decide(made_up(Part::kPpisp, {0.11, 0.11, 0.11})).on);
    EXPECT_FALSE(decide(made_up(Part::kPpisp, {0.09, 0.09, 0.09})).on) << "small";
    EXPECT_FALSE(decide(made_up(Part::kPpisp, {2, -1.4, 0})).on) << "uncertain";
    EXPECT_FALSE(decide(made_up(Part::kPpisp, {-0.3, -0.5, -0.1})).on);
}

TEST(Rehearsal, SaysWhyNothingWasMeasured) {
    for (const Part part : {Part::kPpisp, Part::kCameras}) {
        PartTrial trial{.part = part};
        trial.obstacle = "too few";
        const PartDecision decision = decide(trial);
        EXPECT_FALSE(decision.on);
        EXPECT_EQ(decision.reason, "off: too few");
        const auto event = event_of(trial, decision);
        EXPECT_EQ(event["event"], part == Part::kPpisp ? "photometric" : "refine_cameras");
        EXPECT_EQ(event["on"], false);
        EXPECT_FALSE(event.contains("gain"));
    }
}

Scene scene_off_by(double pixels) {
    SceneOptions options;
    options.resolution = 64;
    Scene scene = load_builtin_scene("diffuse", options);
    scene.train.resize(24);
    std::mt19937 rng(7);
    std::normal_distribution<double> normal;
    std::vector<Eigen::Vector3d> points;
    for (const Eigen::Vector3f& point : scene.points.positions) points.push_back(point.cast<double>());
    for (View& view : scene.train) {
        Vector6d way;
        for (int k = 0; k < 6; ++k) way[k] = pixels * normal(rng);
        view.camera = PoseLearner(view.camera, points).moved(view.camera, way);
    }
    return scene;
}

TrainOptions options_of(std::int64_t iterations) {
    TrainOptions o;
    o.source = "builtin:diffuse", o.model = "unused";
    o.iterations = iterations;
    o.device = Device::kCpu;
    o.cap_max = 1500, o.init_points = 1000;
    o.refine_cameras = RefineCameras::kAuto;
    return resolve(o);
}

TEST(Rehearsal, FindsCamerasThatAreOff) {
    const Scene off = scene_off_by(1), right = scene_off_by(0);
    const Scene before = off;
    TrainOptions options = options_of(6000);
    options.schedule = ScheduleKind::kFixed;  // cameras learn from iteration 1000 on
    const auto trials = rehearse(options, off);
    ASSERT_EQ(trials.size(), 1u);
    EXPECT_EQ(options.refine_cameras, RefineCameras::kOn) << decide(trials[0]).reason;
    EXPECT_EQ(trials[0].without.ssim.size(), 3u);
    EXPECT_EQ(trials[0].iterations, 600);
    EXPECT_GT(trials[0].correction, 0.5);
    for (std::size_t k = 0; k < off.train.size(); ++k)
        EXPECT_EQ(off.train[k].camera.translation, before.train[k].camera.translation) << "the scene stays as it is";
    options = options_of(6000);
    const auto of_right = rehearse(options, right);
    EXPECT_EQ(options.refine_cameras, RefineCameras::kOff) << decide(of_right.at(0)).reason;
}

TEST(Rehearsal, TellsExposuresFromTheScene) {
    SceneOptions size;
    size.resolution = 64;
    for (const bool differ : {true, false}) {
        const Scene scene = load_builtin_scene(differ ? "exposure" : "polished", size);
        TrainOptions options = options_of(6000);
        options.ppisp = PpispMode::kAuto, options.refine_cameras = RefineCameras::kOff;
        const auto trials = rehearse(options, scene);
        ASSERT_EQ(trials.size(), 1u);
        EXPECT_EQ(options.ppisp, differ ? PpispMode::kOn : PpispMode::kOff) << decide(trials[0]).reason;
        EXPECT_EQ(trials[0].iterations, 400);
        EXPECT_EQ(trials[0].correction > 0.08, differ) << trials[0].correction;
    }
}

TEST(Rehearsal, DecidesBothParts) {
    TrainOptions options = options_of(6000);
    options.ppisp = PpispMode::kAuto, options.ppisp_exif = true;
    const auto trials = rehearse(options, scene_off_by(0));
    ASSERT_EQ(trials.size(), 2u);
    EXPECT_STREQ(option_of(trials[0].part), "ppisp");
    EXPECT_STREQ(option_of(trials[1].part), "refine-cameras");
    for (const PartTrial& trial : trials) EXPECT_EQ(trial.with.psnr.size(), 3u) << trial.obstacle;
    EXPECT_EQ(options.ppisp, PpispMode::kOff);
    EXPECT_EQ(options.refine_cameras, RefineCameras::kOff);
    EXPECT_FALSE(options.ppisp_exif) << "options of a run without PPISP are valid";
}

TEST(Rehearsal, MasksMayLeaveNothing) {
    Scene scene = scene_off_by(0);
    for (View& view : scene.train)
        view.load = [load = view.load] {
            ViewImage image = load();
            image.mask = Image{image.color.width, image.color.height, 1, {}, {}};
            image.mask->u8.assign(std::size_t(image.color.width) * std::size_t(image.color.height), 0);
            return image;
        };
    TrainOptions options = options_of(6000);
    options.ppisp = PpispMode::kAuto;
    const auto trials = rehearse(options, scene);
    ASSERT_EQ(trials.size(), 2u);
    for (const PartTrial& trial : trials) EXPECT_EQ(trial.obstacle.substr(0, 5), "masks") << trial.obstacle;
}

TEST(Rehearsal, NeedsViewsAndIterations) {
    Scene scene = scene_off_by(0);
    const auto obstacle = [&](TrainOptions options) { return rehearse(options, scene).at(0).obstacle; };
    TrainOptions limited = options_of(6000);
    limited.time_limit = Duration{1e-3};
    EXPECT_NE(obstacle(limited).find("too short"), std::string::npos);
    EXPECT_NE(obstacle(options_of(3000)).find("300 iterations"), std::string::npos);
    scene.train.resize(15);
    EXPECT_NE(obstacle(options_of(6000)).find("15 training views"), std::string::npos);
}

}  // namespace
}  // namespace gs
