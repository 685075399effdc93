// SPDX-License-Identifier: Apache-2.0
// `gsapp prune-appearance` as a user calls it.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

constexpr const char* kTrain = "train -s builtin:glossy --device cpu -r 16 --eval --iterations 10 ";

TEST(PruneAppearanceProgram, WritesARunThatLooksTheSame) {
    const Program program;
    // SV's residual is active from the start, and has not grown everywhere after so short a time.
    ASSERT_EQ(program.run(std::string(kTrain) + "--appearance sv -m run").exit_code, 0);
    const Outcome outcome = program.run("prune-appearance run/");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const auto facts = parse_json(program.read("run-pruned/pruned.json"));
    const int pruned = facts["pruned"], count = facts["num_gaussians"];
    EXPECT_GT(pruned, 0);
    EXPECT_LT(pruned, count);
    EXPECT_EQ(facts["bytes_saved"], pruned * 49 * 4);
    EXPECT_NEAR(facts["after"]["PSNR"].get<double>(), facts["before"]["PSNR"].get<double>(), 0.1);
    EXPECT_EQ(outcome.out.find(std::to_string(pruned) + " of " + std::to_string(count) + " Gaussians"), 0u)
        << outcome.out;

    ASSERT_EQ(program.run("eval run run-pruned").exit_code, 0);
    const auto psnr = [&](const std::string& run) {
        return parse_json(program.read(run + "/results.json"))["ours_10"]["PSNR"].get<double>();
    };
    EXPECT_NEAR(psnr("run"), facts["before"]["PSNR"].get<double>(), 1e-9);
    EXPECT_NEAR(psnr("run-pruned"), facts["after"]["PSNR"].get<double>(), 1e-9);
    EXPECT_EQ(program.run("render run-pruned --orbit 1").exit_code, 0);

    const Outcome again = program.run("prune-appearance run");
    EXPECT_EQ(again.exit_code, 2);
    EXPECT_NE(again.err.find("run-pruned is not empty"), std::string::npos) << again.err;
    const Outcome twice = program.run("prune-appearance run-pruned -o twice");
    ASSERT_EQ(twice.exit_code, 0) << twice.err;
    EXPECT_EQ(parse_json(program.read("twice/pruned.json"))["pruned"], pruned);
    EXPECT_EQ(program.read("twice/point_cloud/iteration_10/point_cloud.ply"),
              program.read("run-pruned/point_cloud/iteration_10/point_cloud.ply"));
}

TEST(PruneAppearanceProgram, RefusesModelsWithoutResidualsOfTheirOwn) {
    const Program program;
    for (const auto& [model, reason] :
         {std::pair("none", "no view-dependent parameters"), std::pair("neural", "a network that all of them share")}) {
        ASSERT_EQ(program.run(std::string(kTrain) + "--appearance " + model + " -m " + model).exit_code, 0);
        const Outcome outcome = program.run(std::string("prune-appearance ") + model);
        EXPECT_EQ(outcome.exit_code, 2);
        EXPECT_NE(outcome.err.find(reason), std::string::npos) << outcome.err;
        EXPECT_FALSE(std::filesystem::exists(program.path(std::string(model) + "-pruned")));
    }
}

}  // namespace
}  // namespace gs
