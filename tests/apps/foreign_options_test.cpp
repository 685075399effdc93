// SPDX-License-Identifier: Apache-2.0
// Command lines of other programs, and names that are not UTF-8, given to the built program.
#include <gtest/gtest.h>
#include <algorithm>
#include <nlohmann/json.hpp>

#include "lib/core/foreign_options.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "tests/apps/program.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

/// Returns the value with which an option of 3DGS's train.py is tried; empty for switches.
std::string value_for(const ForeignOption& foreign) {
    if (foreign.use == ForeignUse::kSets || foreign.is_switch) return "";
    if (foreign.use != ForeignUse::kSynonym) return "5";
    if (foreign.key == "source") return "builtin:diffuse";
    if (foreign.key == "model") return "run";
    if (foreign.key == "iterations") return "2";
    if (foreign.key == "resolution") return "8";
    if (foreign.key == "resume") return "run/checkpoints/iteration_2.safetensors";
    if (foreign.key.ends_with("-iterations")) return "1 2";
    const auto& table = train_option_table();
    const Option& option =
        *std::find_if(table.begin(), table.end(), [&](const Option& o) { return o.key == foreign.key; });
    if (std::holds_alternative<bool TrainOptions::*>(option.field)) return "";
    const std::string text = option_text(option, {});
    return text == "0" ? "0.025" : text == "-1" ? "7" : text;  // what stands for a rule there is a number in 3DGS
}

TEST(ForeignOptions, EveryOptionOf3dgsRunsOrSaysWhyNot) {
    const Program program;
    ASSERT_EQ(program.run("train -s builtin:diffuse -r 8 --iterations 2 --device cpu -m run").exit_code, 0);
    int tried = 0;
    for (const ForeignOption& foreign : foreign_programs().front().options) {
        std::string arguments = "train --overwrite --device cpu";
        if (foreign.key != "source" && foreign.key != "resume") arguments += " -s builtin:diffuse";
        if (foreign.key != "model") arguments += " -m run";
        if (foreign.key != "resolution") arguments += " -r 8";
        if (foreign.key != "iterations") arguments += " --iterations 2";
        const Outcome outcome = program.run(arguments + " " + foreign.name + " " + value_for(foreign));
        const std::string named = foreign.name + " of 3DGS";
        const bool missing = foreign.use == ForeignUse::kMissing, ignored = foreign.use == ForeignUse::kIgnored;
        EXPECT_EQ(outcome.exit_code, missing ? 2 : 0) << foreign.name << "\n" << outcome.err;
        const std::string expected = missing   ? "error: " + named + ": not yet: " + foreign.note
                                     : ignored ? "warning: " + named + " is ignored: " + foreign.note
                                               : named;
        const auto said = outcome.err.find(expected);
        EXPECT_EQ(said != std::string::npos, missing || ignored) << foreign.name << "\n" << outcome.err;
        if (said != std::string::npos) {
            EXPECT_EQ(outcome.err.find(named, said + expected.size()), std::string::npos) << outcome.err;
        }
        ++tried;
    }
    EXPECT_EQ(tried, 48);
}

TEST(ForeignOptions, CommandLinesOfOtherProgramsTrain) {
    const Program program;
    for (const char* line :
         {"-s builtin:diffuse -m inria -r 8 --iterations 2 --test_iterations 1 2 --save_iterations 2 --eval --quiet",
          "--data_dir builtin:diffuse --data_factor 8 --result_dir gsplat --max_steps 2 --eval_steps 1 2 "
          "--disable_viewer",
          "--data builtin:diffuse --output-dir nerfstudio --max-num-iterations 2 -r 8 --vis viewer",
          "mcmc --eval_steps -1 --disable_viewer --data_factor 8 --strategy.cap-max 1000 --render_traj_path ellipse "
          "--data_dir builtin:diffuse --result_dir mcmc --max_steps 2",
          "default --data_dir builtin:diffuse --data_factor 8 --result_dir default --max_steps 2"}) {
        const Outcome outcome = program.run(std::string("train ") + line + " --device cpu");
        EXPECT_EQ(outcome.exit_code, 0) << line << "\n" << outcome.err;
    }
    for (const char* run : {"inria", "gsplat", "nerfstudio", "mcmc", "default"})
        EXPECT_TRUE(std::filesystem::exists(program.path(run) / "point_cloud/iteration_2/point_cloud.ply")) << run;
    const Outcome scored = program.run("eval -m inria --protocol inria");
    EXPECT_EQ(scored.exit_code, 0) << scored.err;
    EXPECT_NE(scored.out.find("| inria |"), std::string::npos) << scored.out;
    const Outcome measured = program.run("metrics -m inria --metrics psnr,ssim --json");
    EXPECT_EQ(measured.exit_code, 0) << measured.err;
    EXPECT_NE(measured.out.find("\"PSNR\""), std::string::npos) << measured.out;
    EXPECT_EQ(program.run("metrics -m inria --lpips-range unit").exit_code, 2);
    EXPECT_EQ(program.run("metrics inria").exit_code, 2) << "one image";
    EXPECT_EQ(program.run("eval --model_path inria --skip-render --json -q").exit_code, 0);
}

// Names that are not UTF-8: folders and images as older archives have them, through every subcommand.

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
