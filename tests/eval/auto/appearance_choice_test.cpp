// SPDX-License-Identifier: Apache-2.0
#include "eval/auto/appearance_choice.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>

#include "eval/auto/find_appearance.h"
#include "kernels/base/clock.h"
#include "lib/core/options.h"
#include "lib/scene/scene.h"
#include "lib/train/trial_training.h"

namespace gs {
namespace {

/// model, bytes, seconds, psnr
const AppearanceTrial kNone{"none", 12, 1, 25};

TEST(AppearanceChoice, KeepsTheSmallestWithinTheTolerance) {
    const std::vector<AppearanceTrial> trials = {kNone, {"small", 44, 3, 26.91}, {"large", 200, 2, 27}};
    EXPECT_EQ(choose_appearance(trials, 0.1).chosen, 1u);
    EXPECT_EQ(choose_appearance(trials, 0.05).chosen, 2u);
    EXPECT_EQ(choose_appearance(trials, 2).chosen, 0u);
    EXPECT_EQ(choose_appearance(trials, 2).best, 2u);
}

TEST(AppearanceChoice, DecidesBetweenEqualBytesByTime) {
    const std::vector<AppearanceTrial> trials = {kNone, {"slow", 44, 3, 27}, {"fast", 44, 2, 26.95}};
    EXPECT_EQ(choose_appearance(trials, 0.1).chosen, 2u);
    EXPECT_EQ(choose_appearance(trials, 0).chosen, 1u);
}

TEST(AppearanceChoice, PassesOverTrialsThatFailed) {
    const AppearanceTrial failed{"failed", 10, 1, std::numeric_limits<double>::quiet_NaN()};
    EXPECT_EQ(choose_appearance({kNone, failed}, 0.1).chosen, 0u);
    EXPECT_EQ(choose_appearance({failed}, 0.1).chosen, 0u);
    EXPECT_EQ(choose_appearance({failed, kNone}, 0.1).chosen, 1u);
}

TEST(AppearanceChoice, SaysWhatRemains) {
    // photometric, direction, held-out direction
    EXPECT_EQ(classify_remaining_error({0.05, 0.12, 0.08}, 0.1), RemainingError::kReflectance);
    EXPECT_EQ(classify_remaining_error({0.05, 0.12, 0.08}, 1), RemainingError::kUnresolved)
        << "0.56 dB are less than what is allowed";
    EXPECT_EQ(classify_remaining_error({0.05, 0.01, -0.02}, 0.1), RemainingError::kUnresolved);
    EXPECT_EQ(classify_remaining_error({0.05, 0.09, -0.4}, 0.1), RemainingError::kInconsistency);
    EXPECT_EQ(classify_remaining_error({0.7, 0.06, 0.09}, 0.1), RemainingError::kPhotometric);
}

TEST(AppearanceChoice, ValuesDirectionInDecibels) {
    EXPECT_NEAR(gain_in_decibels(0.9), 10, 1e-9);
    EXPECT_EQ(gain_in_decibels(0), 0);
    EXPECT_LT(gain_in_decibels(-0.1), 0);
    EXPECT_TRUE(std::isfinite(gain_in_decibels(1)));
}

TEST(AppearanceChoice, DecidesFromMeasurementsAlone) {
    AppearanceMeasurements measured;
    measured.plain_model = "none";
    measured.parts = {0.05, 0.12, 0.08};
    EXPECT_TRUE(needs_trials(measured.parts, 0.1));
    EXPECT_FALSE(needs_trials(measured.parts, 1));
    AppearanceDecision decision = decide_appearance(measured, 1);
    EXPECT_EQ(decision.model, "none");
    EXPECT_EQ(decision.remaining, RemainingError::kUnresolved);
    EXPECT_FALSE(decision.choice);
    measured.trials = {kNone, {"small", 44, 3, 26.91}, {"large", 200, 2, 27}};
    decision = decide_appearance(measured, 0.1);
    EXPECT_EQ(decision.model, "small");
    EXPECT_EQ(decision.remaining, RemainingError::kReflectance);
    ASSERT_TRUE(decision.choice);
    EXPECT_EQ(decision.choice->best, 2u);
    measured.obstacle = Obstacle::kMasks;
    EXPECT_EQ(decide_appearance(measured, 0.1).model, "none") << "nothing was measured";
    measured.obstacle = Obstacle::kShort;
    EXPECT_EQ(decide_appearance(measured, 0.1).model, "sv");
    measured.one_sided = true;
    EXPECT_EQ(decide_appearance(measured, 0.1).model, "sh");
}

TrainOptions glossy(int width, std::int64_t iterations) {
    TrainOptions options;
    options.source = "builtin:glossy";
    options.resolution = width;
    options.iterations = iterations;
    options.device = Device::kCpu;
    options = resolve(options);
    return options;
}

/// Returns the scene with some of its points: images of 16 pixels need no more, and iterations are short.
Scene coarse_scene(const TrainOptions& options) {
    Scene scene = load_scene(options);
    scene.points.positions.resize(300), scene.points.colors.resize(300);
    return scene;
}

TEST(FindAppearance, ChoosesFromHeldOutTrainingViews) {
    TrainOptions options = glossy(16, 7500);
    options.auto_tolerance = 0;
    Scene scene = coarse_scene(options);
    const AppearanceReport report = find_appearance(options, scene);
    EXPECT_EQ(report.lines.size(), 5u);
    EXPECT_EQ(report.json.at("model"), report.model);
    EXPECT_EQ(report.json.at("warm_up_iterations"), 500);
    EXPECT_EQ(report.lines[3].find("held out after 500 iterations of each: none "), 0u) << report.lines[3];
    EXPECT_EQ(report.json.at("trials").at(0).at("model"), "none");
    EXPECT_TRUE(std::isfinite(report.json.at("trials").at(0).at("PSNR").get<double>()));
    options.auto_tolerance = 100;
    const AppearanceReport lenient = find_appearance(options, scene);
    EXPECT_EQ(lenient.model, "none");
    EXPECT_TRUE(lenient.json.at("trials").empty()) << "direction cannot be worth that much";
    scene.train.resize(7);
    const AppearanceReport few = find_appearance(options, scene);
    EXPECT_EQ(few.model, "none") << "no view can be held out";
    EXPECT_EQ(few.json.at("lines"), few.lines);
}

TEST(FindAppearance, DoesNotRankAfterAFewIterations) {
    const TrainOptions options = glossy(16, 1500);
    Scene scene = coarse_scene(options);
    const AppearanceReport report = find_appearance(options, scene);
    EXPECT_EQ(report.model, "sv");
    ASSERT_EQ(report.lines.size(), 1u);
    EXPECT_NE(report.lines[0].find("too short to tell"), std::string::npos) << report.lines[0];
    for (View& view : scene.train) view.camera.rotation = scene.train.front().camera.rotation;
    const AppearanceReport one_sided = find_appearance(options, scene);
    EXPECT_EQ(one_sided.model, "sh");
    EXPECT_NE(one_sided.lines[0].find("the same way"), std::string::npos) << one_sided.lines[0];
}

TEST(FindAppearance, TakesATenthOfATimeLimit) {
    TrainOptions options = glossy(16, 30000);
    options.time_limit = parse_duration("0.5s", "");
    const Scene scene = coarse_scene(options);
    EXPECT_EQ(find_appearance(options, scene).model, "sv") << "50 ms are too short";
    options.time_limit = parse_duration("20s", "");
    const double start = seconds_now();
    find_appearance(options, scene);
    EXPECT_LT(seconds_now() - start, 2 + 3) << "with slack for machines that are busy";
}

TEST(FindAppearance, AViewPastEverythingDecidesNothing) {
    TrainOptions options = glossy(16, 7500);
    options.auto_tolerance = 0;
    Scene scene = coarse_scene(options);
    View& away = scene.train[4];  // one that is held out
    away.camera.translation.z() -= 1e6;
    away.load = [load = away.load] {
        ViewImage black = load();
        std::fill(black.color.u8.begin(), black.color.u8.end(), std::uint8_t(0));
        return black;
    };
    const AppearanceReport report = find_appearance(options, scene);
    EXPECT_FALSE(report.json.at("trials").empty());
    for (const auto& trial : report.json.at("trials")) EXPECT_TRUE(trial.at("PSNR").is_number()) << trial;
}

TEST(FindAppearance, TakesNoneWhereMasksLeaveNothing) {
    const TrainOptions options = glossy(16, 7500);
    Scene scene = coarse_scene(options);
    for (View& view : scene.train)
        view.load = [load = view.load] {
            ViewImage image = load();
            image.mask.emplace();
            image.mask->width = image.color.width, image.mask->height = image.color.height, image.mask->channels = 1;
            image.mask->u8.assign(std::size_t(image.color.width * image.color.height), 0);
            return image;
        };
    const AppearanceReport report = find_appearance(options, scene);
    EXPECT_EQ(report.model, "none");
    EXPECT_NE(report.lines.front().find("masks"), std::string::npos) << report.lines.front();
}

TEST(TrialTraining, AStretchThatTakesTooLongHasNoResult) {
    TrainOptions options;
    options.source = "builtin:diffuse";
    options.resolution = 16;
    options.appearance = "none";
    options.device = Device::kCpu;
    options = resolve(options);
    const Scene scene = load_scene(options);
    TrialTraining trial(options, scene);
    const Gaussians begun = trial.begin(options, 2).backend->download(false);
    EXPECT_FALSE(trial.continue_with(begun, options, 1000000000, 0.05));
    EXPECT_TRUE(trial.continue_with(begun, options, 2));
}

// The words and the JSON of made-up measurements.

AppearanceMeasurements some_measurements() {
    AppearanceMeasurements m;
    m.num_views = 80, m.num_held_out = 10;
    m.image_width = 400, m.image_height = 300;
    m.warm_up_iterations = 2000, m.trial_iterations = 1000;
    m.plain_model = "none", m.plain_bytes = 12;
    m.parts = {0.2, 0.25, 0.125};
    m.seconds = 12.34;
    return m;
}

AppearanceReport report(const AppearanceMeasurements& m, double tolerance) {
    return describe_appearance(m, decide_appearance(m, tolerance), tolerance);
}

TEST(AppearanceReport, SaysWhatTheTrialsGave) {
    AppearanceMeasurements m = some_measurements();
    m.trials = {{"none", 12, 0.001, 25}, {"nasg", 44, 0.002, 26.95}, {"sh", 192, 0.003, 27}};
    m.unfinished = {"neural", "sv"};
    const AppearanceReport r = report(m, 0.1);
    EXPECT_EQ(r.model, "nasg");
    EXPECT_EQ(r.lines,
              (std::vector<std::string>{
                  "10 of 80 training views held out; none trained for 2000 iterations at 400x300; 12.3 s in all",
                  "of the error without view dependence 20.0 % is explained by direction (10.0 % on held-out views), "
                  "20.0 % by photometric change of whole images, 60.0 % by neither",
                  "what is left is reflectance",
                  "held out after 1000 iterations of each: none 25.00 dB (12 B), nasg 26.95 dB (44 B), sh 27.00 dB "
                  "(192 B); no time to finish neural, sv",
                  "nasg: 44 bytes per Gaussian, 0.05 dB below sh, the best; 0.1 dB are allowed"}));
    EXPECT_EQ(r.json["model"], "nasg");
    EXPECT_EQ(r.json["trials"].size(), 3u);
    EXPECT_EQ(r.json["trials"][2]["bytes_per_gaussian"], 192);
    EXPECT_EQ(r.json["no_time_for"], (std::vector<std::string>{"neural", "sv"}));
    EXPECT_EQ(r.json["remainder"], "reflectance");
    EXPECT_EQ(r.json["lines"], r.lines);
    EXPECT_NEAR(r.json["explained"]["neither"].get<double>(), 0.6, 1e-12);
}

TEST(AppearanceReport, SaysThatNothingHadToBeTried) {
    const AppearanceReport r = report(some_measurements(), 3);
    EXPECT_EQ(r.model, "none");
    EXPECT_EQ(r.lines[3], "no model was tried: direction is worth 1.25 dB, and 3 dB are allowed");
    EXPECT_EQ(r.lines[4], "none: 12 bytes per Gaussian");
    EXPECT_TRUE(r.json["trials"].empty());
}

TEST(AppearanceReport, HasNoNumberForATrialThatFailed) {
    AppearanceMeasurements m = some_measurements();
    m.trials = {{"none", 12, 0.001, 25}, {"sh", 192, 0.003, std::numeric_limits<double>::quiet_NaN()}};
    EXPECT_TRUE(report(m, 0.1).json["trials"][1]["PSNR"].is_null());
}

TEST(AppearanceReport, SaysInOneLineWhyNothingWasMeasured) {
    AppearanceMeasurements m = some_measurements();
    m.num_views = 7, m.obstacle = Obstacle::kFewViews;
    EXPECT_EQ(report(m, 0.1).lines,
              (std::vector<std::string>{"none: of 7 training views none can be held out (8 are needed), and only these "
                                        "could show that direction matters"}));
    m.obstacle = Obstacle::kMasks;
    const AppearanceReport r = report(m, 0.1);
    EXPECT_EQ(r.lines.size(), 1u);
    EXPECT_EQ(r.json["model"], "none");
    EXPECT_EQ(r.json["lines"], r.lines);
    EXPECT_FALSE(r.json.contains("trials"));
    m.obstacle = Obstacle::kShort, m.trial_iterations = 20;
    EXPECT_EQ(report(m, 0.1).lines.front(),
              "sv: too short to tell: a trial would have 20 iterations, and 500 are needed");
}

}  // namespace
}  // namespace gs
