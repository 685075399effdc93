// SPDX-License-Identifier: Apache-2.0
// Names that are not UTF-8: folders and images as older archives have them, through every subcommand.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "tests/apps/program.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

/// Two names that become one if their bytes are replaced by the same character.
TEST(Names, ThatDifferInBytesThatAreNotUtf8StayApart) {
    const Program program;
    const std::vector<std::string> names = {"im\xE0.png", "im\xE1.png", "im\xE2.png", "im\xE3.png"};
    test::write_colmap_scene(program.path("scene"), names);
    const std::string common = "train -s scene --device cpu --iterations 3 --controller-iterations 0 ";
    const Outcome first = program.run(common + "--eval --test-every 2 --ppisp on -m first");
    ASSERT_EQ(first.exit_code, 0) << first.err;
    const auto scored = parse_json(program.read("first/per_view.json")).at("image_names").at("ours_3");
    EXPECT_EQ(scored.at("00000.png"), names[0]);
    EXPECT_EQ(scored.at("00001.png"), names[2]);
    const auto frames = parse_json(program.read("first/ppisp.json")).at("frames");
    EXPECT_EQ(frames.at(0).at("image"), names[1]);
    EXPECT_EQ(frames.at(1).at("image"), names[3]);
    const Outcome second = program.run(common + "--eval --test-every 2 --ppisp-from first/ppisp.json -m second");
    EXPECT_EQ(second.exit_code, 0) << second.err;
}

TEST(Names, ThatAreNotUtf8ServeFromTrainingToResults) {
    const Program program;
    const std::string e = "\xE9";  // é in Latin-1
    const std::string scene = "sc" + e + "ne", run = "r" + e + "sultat";
    std::vector<std::string> names;
    for (int i = 0; i < 9; ++i) names.push_back("caf" + e + std::to_string(i) + ".png");
    test::write_colmap_scene(program.path(scene), names);
    program.folder().write("li" + e, names[4] + "\n");

    const auto expect_ok = [&](const std::string& arguments) {
        const Outcome outcome = program.run(arguments);
        EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.err;
        return outcome;
    };
    const std::string options =
        " --device cpu --eval --save-iterations 2 4 --checkpoint-iterations 2 -s '" + scene + "'";
    expect_ok("train --iterations 4 --preview-every 2" + options + " -m '" + run + "'");
    expect_ok("train --iterations 2 -c '" + run + "/config.yaml' -m 'ag" + e + "in'");
    expect_ok("train --iterations 6 --resume latest" + options + " -m '" + run + "'");
    const auto results = parse_json(program.read(run + "/results.json"));
    ASSERT_TRUE(results.contains("ours_6"));
    EXPECT_EQ(results["run"]["ours_6"]["scene"], scene);
    EXPECT_NE(program.read(run + "/results.json").find("\"sc\\udce9ne\""), std::string::npos);
    const auto cameras = parse_json(program.read(run + "/cameras.json"));
    EXPECT_EQ(cameras.size(), 9u);

    // The run folder alone leads back to the scene, whose name config.yaml holds byte for byte.
    EXPECT_NE(program.read(run + "/config.yaml").find("/" + scene + "\"\n"), std::string::npos);
    const Outcome table = expect_ok("eval '" + run + "' --decompose --html 'p" + e + "ge.html'");
    EXPECT_NE(table.out.find("sc\xEF\xBF\xBDne"), std::string::npos) << table.out;
    for (const char* format : {"csv", "latex", "json"})
        expect_ok("eval --skip-render '" + run + "' --format " + format);
    expect_ok("render '" + run + "' -o 'r" + e + "nder'");
    expect_ok("export '" + run + "' -o 's" + e + "te'");
    expect_ok("export '" + run + "' -o 's" + e + "te' --format ply");
    expect_ok("bench frames '" + run + "' --frame-repeat 1");
    expect_ok("metrics '" + scene + "/images/" + names[0] + "' '" + scene + "/images/" + names[1] + "' --metrics psnr");
    expect_ok("train --iterations 2 --device cpu --eval --test-list 'li" + e + "' -s '" + scene + "' -m list");

    const Outcome refused = program.run("eval '" + e + "'");
    EXPECT_EQ(refused.exit_code, 3) << refused.err;
    EXPECT_EQ(program.run("train --iterations 2 -s '" + e + "' -m x").exit_code, 3);
    EXPECT_EQ(program.run("train --" + e).exit_code, 2);
}

}  // namespace
}  // namespace gs
