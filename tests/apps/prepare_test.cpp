// SPDX-License-Identifier: Apache-2.0
// gsapp prepare with a stand-in for colmap: what the user reads.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "tests/apps/program.h"
#include "tests/scene/fake_programs.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using test::Outcome;
using test::Program;

/// Writes ten photographs and a colmap that registers the first `registered` of them.
Outcome prepare_ten(const Program& program, std::size_t registered, const std::string& before = "",
                    const std::string& options = "") {
    std::vector<std::string> names;
    for (int i = 0; i < 10; ++i) {
        names.push_back("p" + std::to_string(i) + ".png");
        test::write_png(program.path("photos") / names.back());
    }
    names.resize(registered);
    test::write_model(program.path("model"), {test::TestCamera{}}, test::row_of_images(names), {{1}, {2}});
    fs::permissions(program.folder().write("colmap", test::kFakeColmap), fs::perms::owner_all);
    return program.run("prepare photos -o scene " + options,
                       before + " PATH=\"$PWD:$PATH\" COLMAP_CALLS=\"$PWD/calls\" COLMAP_MODEL=\"$PWD/model\"");
}

TEST(PrepareCommand, SaysWhatCameOfThePhotographs) {
    const Program program;
    const Outcome outcome = prepare_ten(program, 9);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    for (const char* line :
         {"info: COLMAP 3.8 without CUDA: features and matches are computed on the CPU\n",
          "info: matching: 10 photographs: all pairs\n", "info: [1/4] features\n", "info: [4/4] undistorted\n",
          "info: 9 of 10 photographs registered, 2 points, mean reprojection error 0.48 px\n",
          "info: left out: p9.png\n", "scene/colmap.log", "gsapp train -s scene --eval"})
        EXPECT_NE(outcome.err.find(line), std::string::npos) << line << "in\n" << outcome.err;
    EXPECT_EQ(outcome.err.find("without CUDA"), outcome.err.rfind("without CUDA")) << "said once";
    EXPECT_EQ(outcome.err.find("warning"), std::string::npos) << outcome.err;
}

TEST(PrepareCommand, WarnsOfMissingPhotographsAndNamesTheLogOfAFailure) {
    const Program program;
    const Outcome poor = prepare_ten(program, 8);
    ASSERT_EQ(poor.exit_code, 0) << poor.err;
    EXPECT_NE(poor.err.find("warning: 8 of 10 photographs registered"), std::string::npos) << poor.err;
    EXPECT_NE(poor.err.find("warning: left out: p8.png, p9.png"), std::string::npos) << poor.err;
    EXPECT_NE(poor.err.find("more overlap"), std::string::npos) << poor.err;
    fs::remove_all(program.path("scene"));
    const Outcome failed = prepare_ten(program, 8, "COLMAP_FAILS_AT=mapper");
    EXPECT_EQ(failed.exit_code, 3);
    EXPECT_NE(failed.err.find("colmap mapper ended with exit code 3"), std::string::npos) << failed.err;
    EXPECT_NE(failed.err.find("all that was printed is in scene/colmap-failed.log"), std::string::npos) << failed.err;
}

TEST(PrepareCommand, TellsProgramsWhatCameOfThePhotographs) {
    const Program program;
    const Outcome outcome = prepare_ten(program, 9, "", "--json --quiet");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    const nlohmann::json report = parse_json(outcome.out);
    EXPECT_EQ(report["scene"], "scene");
    EXPECT_EQ(report["photographs"], 10);
    EXPECT_EQ(report["registered"], 9);
    EXPECT_EQ(report["points"], 2);
    EXPECT_NEAR(report["mean_reprojection_error"], 0.48, 0.005);
    EXPECT_EQ(report["left_out"], nlohmann::json({"p9.png"}));
    EXPECT_EQ(report["other_models"], nlohmann::json({1}));
    EXPECT_TRUE(fs::exists(program.path(report["log"]))) << report["log"];
}

TEST(PrepareCommand, OptionsAreChecked) {
    const Program program;
    for (const char* wrong : {"--matching all", "--fps soon", "--fps 2"})
        EXPECT_EQ(program.run(std::string("prepare . -o scene ") + wrong).exit_code, 2) << wrong;
    EXPECT_EQ(program.run("prepare missing -o scene").exit_code, 2);
}

}  // namespace
}  // namespace gs
