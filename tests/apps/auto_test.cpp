// SPDX-License-Identifier: Apache-2.0
// `gsapp train --appearance auto` as a user calls it.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

constexpr const char* kTrain = "train -s builtin:glossy --device cpu -r 16 --eval --init-points 500 --cap-max 500 ";

TEST(AutoAppearance, TrainsTheChosenModelAsIfItHadBeenNamed) {
    const Program program;
    const Outcome chosen = program.run(std::string(kTrain) + "--iterations 400 --appearance auto -m chosen");
    ASSERT_EQ(chosen.exit_code, 0) << chosen.err;
    const auto choice = parse_json(program.read("chosen/auto.json"));
    const std::string model = choice["model"];
    // So short a run ranks nothing; tests/eval/auto has what longer ones do.
    EXPECT_EQ(model, "sv");
    EXPECT_EQ(choice["lines"].size(), 1u);
    EXPECT_NE(chosen.err.find("too short to tell"), std::string::npos) << chosen.err;
    EXPECT_GT(choice["share_of_training"], 0.0);
    EXPECT_NE(program.read("chosen/config.yaml").find("appearance: " + model), std::string::npos);
    EXPECT_EQ(parse_json(program.read("chosen/results.json"))["appearance_choice"]["ours_400"]["model"], model);
    ASSERT_EQ(program.run(std::string(kTrain) + "--iterations 400 --appearance " + model + " -m named").exit_code, 0);
    EXPECT_FALSE(std::filesystem::exists(program.path("named/auto.json")));
    const std::string ply = "/point_cloud/iteration_400/point_cloud.ply";
    EXPECT_EQ(program.read("chosen" + ply), program.read("named" + ply))
        << "the choice leaves nothing behind in the training";
}

TEST(AutoAppearance, AResumedRunDoesNotDecideAgain) {
    const Program program;
    ASSERT_EQ(program.run(std::string(kTrain) + "--iterations 100 --appearance auto -m run").exit_code, 0);
    // The share of the training is that of the whole run, which has become longer.
    const auto decision = [&] {
        const std::string choice = program.read("run/auto.json");
        return choice.substr(0, choice.find("share_of_training"));
    };
    const std::string first = decision();
    EXPECT_GT(first.size(), 100u);
    for (const char* resume : {"train -m run --resume latest --iterations 101",
                               "train -m run --resume latest --iterations 102 --appearance auto"}) {
        const Outcome resumed = program.run(resume);
        ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
        EXPECT_EQ(resumed.err.find("--appearance auto: "), std::string::npos) << resumed.err;
        EXPECT_EQ(decision(), first);
    }
}

TEST(AutoAppearance, IsRefusedWhereRunsAreCompared) {
    const Program program;
    for (const char* command :
         {"train --eval --runs 2 --appearance auto", "bench suite densification --appearances sh,auto",
          "tradeoff --axes appearance=none,auto", "tradeoff --axes budget --appearance auto"}) {
        const Outcome outcome = program.run(std::string(command) + " -s builtin:diffuse --device cpu -r 8 -m out");
        EXPECT_EQ(outcome.exit_code, 2) << command;
        EXPECT_NE(outcome.err.find("appearance auto: every run that is compared"), std::string::npos) << command << "\n"
                                                                                                      << outcome.err;
        EXPECT_FALSE(std::filesystem::exists(program.path("out"))) << command;
    }
}

}  // namespace
}  // namespace gs
