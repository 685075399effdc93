// SPDX-License-Identifier: Apache-2.0
// Whether cameras are learned: the rule, and the measurement that it follows from.
#include "eval/auto/camera_trial.h"

#include <gtest/gtest.h>

#include <random>

#include "lib/core/options.h"
#include "lib/scene/procedural.h"
#include "lib/scene/scene.h"
#include "lib/train/pose_learner.h"

namespace gs {
namespace {

CameraTrial made_up(const std::vector<double>& ssim_gains, double psnr_gain) {
    CameraTrial trial;
    for (const double gain : ssim_gains) {
        trial.given.ssim.push_back(0.9), trial.learned.ssim.push_back(0.9 + gain);
        trial.given.psnr.push_back(25), trial.learned.psnr.push_back(25 + psnr_gain);
    }
    return trial;
}

TEST(CameraTrial, LearnsCamerasForAClearGainOnly) {
    const CameraDecision clear = decide_cameras(made_up({0.01, 0.012, 0.008}, 0.4));
    EXPECT_TRUE(clear.learn);
    EXPECT_NEAR(clear.gain, 0.1, 1e-9) << "of the 0.1 that SSIM lacks";
    EXPECT_NEAR(clear.error, 0.011547, 1e-6);
    EXPECT_NEAR(clear.decibels, 0.4, 1e-9);
    EXPECT_EQ(clear.reason.substr(0, 3), "on:") << clear.reason;
    EXPECT_FALSE(decide_cameras(made_up({0.002, 0.0022, 0.0018}, 0.4)).learn) << "small";
    EXPECT_FALSE(decide_cameras(made_up({0.04, -0.02, 0.01}, 0.4)).learn) << "uncertain";
    EXPECT_FALSE(decide_cameras(made_up({0.01, 0.012, 0.008}, -0.1)).learn) << "against PSNR";
    EXPECT_FALSE(decide_cameras(made_up({-0.01, -0.012, -0.008}, -0.4)).learn);
}

TEST(CameraTrial, SaysWhyNothingWasMeasured) {
    CameraTrial trial;
    trial.obstacle = "too few";
    const CameraDecision decision = decide_cameras(trial);
    EXPECT_FALSE(decision.learn);
    EXPECT_EQ(decision.reason, "off: too few");
    const auto event = event_of(trial, decision);
    EXPECT_EQ(event["event"], "refine_cameras");
    EXPECT_EQ(event["on"], false);
    EXPECT_FALSE(event.contains("gain"));
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

TEST(CameraTrial, FindsCamerasThatAreOff) {
    const Scene off = scene_off_by(1), right = scene_off_by(0);
    const Scene before = off;
    TrainOptions options = options_of(6000);
    options.schedule = ScheduleKind::kFixed;  // cameras learn from iteration 1000 on
    const CameraTrial trial = try_cameras(options, off);
    const CameraDecision decision = decide_cameras(trial);
    EXPECT_TRUE(decision.learn) << decision.reason;
    EXPECT_EQ(trial.given.ssim.size(), 3u);
    EXPECT_EQ(trial.iterations, 600);
    EXPECT_GT(trial.median_pixels, 0.5);
    for (std::size_t k = 0; k < off.train.size(); ++k)
        EXPECT_EQ(off.train[k].camera.translation, before.train[k].camera.translation) << "the scene stays as it is";
    const CameraDecision of_right = decide_cameras(try_cameras(options_of(6000), right));
    EXPECT_FALSE(of_right.learn) << of_right.reason;
}

TEST(CameraTrial, NeedsViewsAndIterations) {
    Scene scene = scene_off_by(0);
    TrainOptions limited = options_of(6000);
    limited.time_limit = Duration{1e-3};
    EXPECT_NE(try_cameras(limited, scene).obstacle.find("too short"), std::string::npos);
    EXPECT_NE(try_cameras(options_of(3000), scene).obstacle.find("300 iterations"), std::string::npos);
    scene.train.resize(15);
    EXPECT_NE(try_cameras(options_of(6000), scene).obstacle.find("15 training views"), std::string::npos);
}

}  // namespace
}  // namespace gs
