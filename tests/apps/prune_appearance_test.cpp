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

    const Outcome told = program.run("prune-appearance run -o again --json --quiet");
    ASSERT_EQ(told.exit_code, 0) << told.err;
    EXPECT_EQ(told.err, "");
    EXPECT_EQ(parse_json(told.out)["pruned"], pruned);
    EXPECT_EQ(parse_json(told.out)["output"], "again");

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
    EXPECT_EQ(parse_json(program.read("twice/pruned.json"))["pruned"], 0) << "these have lost theirs already";
    EXPECT_EQ(program.read("twice/point_cloud/iteration_10/point_cloud.ply"),
              program.read("run-pruned/point_cloud/iteration_10/point_cloud.ply"));
}

TEST(PruneAppearanceProgram, RefusesAModelWithoutResiduals) {
    const Program program;
    ASSERT_EQ(program.run(std::string(kTrain) + "--appearance none -m run").exit_code, 0);
    const Outcome outcome = program.run("prune-appearance run");
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_NE(outcome.err.find("no view-dependent parameters"), std::string::npos) << outcome.err;
    EXPECT_FALSE(std::filesystem::exists(program.path("run-pruned")));
}

TEST(AppearanceShareProgram, TrainsExportsAndShowsAMixedModel) {
    const Program program;
    const std::string train = "train -s builtin:glossy --device cpu -r 8 --eval --iterations 60 --appearance neural ";
    const Outcome trained = program.run(train + "--appearance-share 0.25 -m run");
    ASSERT_EQ(trained.exit_code, 0) << trained.err;
    EXPECT_NE(trained.err.find("keep a colour that depends on the view (25.0 %)"), std::string::npos) << trained.err;
    const auto results = parse_json(program.read("run/results.json"));
    const double share = results["run"]["ours_60"]["residual_share"];
    EXPECT_NEAR(share, 0.25, 0.02);
    EXPECT_EQ(results["run"]["ours_60"]["bytes_per_gaussian"], std::llround(12 + 32 * share));
    EXPECT_EQ(results["run"]["ours_60"]["web_bytes_per_gaussian"], std::llround(16 + 32 * share));
    EXPECT_EQ(results["run"]["ours_60"]["ply_bytes_per_gaussian"], 100) << "zeros for those without a residual";
    ASSERT_EQ(program.run("eval run").exit_code, 0);
    EXPECT_EQ(parse_json(program.read("run/results.json"))["run"]["ours_60"]["residual_share"], share);
    const Outcome exported = program.run("export run -o web");
    ASSERT_EQ(exported.exit_code, 0) << exported.err;
    EXPECT_NE(exported.err.find("the colour of "), std::string::npos) << exported.err;
    const Outcome compatible = program.run("export run -o compatible --compatible");
    EXPECT_EQ(compatible.exit_code, 2) << "neural has no residual that shows nothing";
    EXPECT_EQ(program.run("render run --orbit 1 --show appearance -o seen").exit_code, 0);
    EXPECT_TRUE(std::filesystem::exists(program.path("seen/00000.png")));
    EXPECT_EQ(program.run("render run --orbit 1 --show appearance --decompose -o seen").exit_code, 2);

    // No residuals at all are another model, and all of them the model that was named.
    ASSERT_EQ(program.run(train + "--appearance-share 0 -m zero").exit_code, 0);
    ASSERT_EQ(program.run(train + "--appearance none -m none").exit_code, 0);
    ASSERT_EQ(program.run(train + "--appearance-share all -m all").exit_code, 0);
    ASSERT_EQ(program.run(train + "-m named").exit_code, 0);
    const std::string ply = "/point_cloud/iteration_60/point_cloud.ply";
    EXPECT_EQ(program.read("zero" + ply), program.read("none" + ply));
    EXPECT_EQ(program.read("all" + ply), program.read("named" + ply));
    EXPECT_FALSE(program.read("all" + ply).empty());
    EXPECT_EQ(program.run(train + "--appearance-share 0.5 --appearance-bytes 20 -m no").exit_code, 2);
    EXPECT_EQ(program.run(train + "--appearance-bytes 8 -m no").exit_code, 2);
    const Outcome bytes = program.run(train + "--appearance-bytes 20 -m bytes");
    EXPECT_NE(bytes.err.find("(25.0 %)"), std::string::npos) << bytes.err;
}

}  // namespace
}  // namespace gs
