// SPDX-License-Identifier: Apache-2.0
// The words and the JSON of made-up measurements.
#include "eval/auto/appearance_choice.h"

#include <gtest/gtest.h>

#include <limits>

namespace gs {
namespace {

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
