// SPDX-License-Identifier: Apache-2.0
// Command lines of other programs, given to the built program.
#include <gtest/gtest.h>

#include <algorithm>

#include "lib/core/foreign_options.h"
#include "lib/core/options.h"
#include "tests/apps/program.h"

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

}  // namespace
}  // namespace gs
