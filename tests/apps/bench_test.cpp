// SPDX-License-Identifier: Apache-2.0
// `gsapp bench` and `gsapp --version` as a user calls them.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

constexpr const char* kFew = " --device cpu --repeat 1 --frame-repeat 1 ";

/// A folder with a run of few Gaussians, saved twice.
class Bench : public testing::Test {
  protected:
    void train() const {
        program.train("run",
                      "-s builtin:diffuse -r 4 --iterations 2 --save-iterations 1 --init-points 400 "
                      "--appearance none --eval");
    }
    Program program;
};

void expect_lines(const Outcome& outcome, std::initializer_list<const char*> lines) {
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    for (const char* line : lines)
        EXPECT_NE(outcome.out.find(line), std::string::npos) << line << "is not in\n" << outcome.out;
}

TEST_F(Bench, MeasuresGeneratedSetsWithoutAScene) {
    EXPECT_EQ(program.run("bench --generate 0.2k").exit_code, 2) << "a count is a whole number";
    expect_lines(program.run("bench --appearance none --generate 1k" + std::string(kFew)),
                 {"generated set of 0.001 M Gaussians, seed 0", "; 1000 Gaussians;", "| 1280x720, 8 views |",
                  "iteration at 1280x720", "| blend backward "});
}

/// The JSON that a command prints, and nothing but it.
nlohmann::json printed_json(const Program& program, const std::string& command) {
    const Outcome outcome = program.run(command + " --json --quiet");
    EXPECT_EQ(outcome.exit_code, 0) << command << "\n" << outcome.err;
    EXPECT_EQ(outcome.err, "") << command;
    const nlohmann::json json = try_parse_json(outcome.out);
    EXPECT_TRUE(json.is_object()) << command << "\n" << outcome.out;
    return json;
}

TEST_F(Bench, PrintsJsonWhereItIsAskedFor) {
    train();
    const auto sets = printed_json(program, "bench --appearance none --generate 1k,2k" + std::string(kFew));
    ASSERT_EQ(sets["results"].size(), 2u);
    EXPECT_EQ(sets["results"][1]["num_gaussians"], 2000);
    EXPECT_GT(sets["results"][1]["iteration"]["seconds"], 0);
    EXPECT_EQ(printed_json(program, "bench -m run" + std::string(kFew))["results"].size(), 1u);
    const auto frames = printed_json(program, "bench frames run --device cpu --frame-repeat 1");
    EXPECT_EQ(frames["lines"][0]["run"], "run");
    EXPECT_GT(frames["lines"][0]["mean_seconds"], 0);
    const auto levels = printed_json(program, "bench precision -m run" + std::string(kFew));
    EXPECT_EQ(levels["levels"][0]["precision"], "full");
    EXPECT_GT(levels["levels"][0]["frame_seconds"], 0);
    EXPECT_GT(printed_json(program, "bench stability")["rows"].size(), 5u);
    EXPECT_EQ(program.run("bench --json frames run").exit_code, 2) << "the option stands before its subcommand";
}

TEST_F(Bench, MeasuresTheTrainedModelWhereThereIsOne) {
    train();
    expect_lines(program.run("bench -m run --compare-deterministic" + std::string(kFew)),
                 {"builtin:diffuse, run at iteration 2", "| 40x30,", "| 1280x720,", "with --deterministic"});
    expect_lines(program.run("bench -m run --iteration 1" + std::string(kFew)), {"run at iteration 1"});
    EXPECT_EQ(program.run("bench -m run --iteration 7").exit_code, 3);
}

TEST_F(Bench, MeasuresInitialPointsElsewhere) {
    expect_lines(program.run("bench -s builtin:diffuse -r 4 --init-points 400" + std::string(kFew)),
                 {"builtin:diffuse, initial points"});
    EXPECT_EQ(program.run("bench -s builtin:diffuse -m none --iteration 1").exit_code, 2);
    EXPECT_EQ(program.run("bench").exit_code, 2);
}

TEST_F(Bench, FramesOfRunsAndOfGeneratedSetsAreOneTable) {
    train();
    const auto before = parse_json(program.read("run/results.json"));
    const Outcome frames =
        program.run("bench frames run --generate 1k --appearances none,sv --device cpu --frame-repeat 2");
    expect_lines(frames, {"| run | scene     | model | device ", "| run | diffuse   | none  | CPU",
                          "| -   | generated | none  | CPU", "| -   | generated | sv    | CPU",
                          "\n\nframe times at 1280x720 pixels"});
    auto after = parse_json(program.read("run/results.json"));
    EXPECT_EQ(after["frame_times"]["ours_2"]["frames_per_view"], 2);
    EXPECT_GE(after["frame_times"]["ours_2"]["max_seconds"], after["frame_times"]["ours_2"]["min_seconds"]);
    after.erase("frame_times");
    EXPECT_EQ(after, before) << "nothing else changes";
    EXPECT_EQ(program.run("bench frames").exit_code, 2);
    EXPECT_EQ(program.run("bench frames nowhere").exit_code, 3);
    EXPECT_EQ(program.run("bench --generate 1k --appearances none").exit_code, 2) << "one model at a time";
}

TEST_F(Bench, TabulatesStabilityWithoutAScene) {
    expect_lines(program.run("bench stability"), {"| softplus ", "| sh ", "on the axis", "N = 0.1542"});
    expect_lines(program.run("bench stability --help"), {"gsapp bench stability"});  // measuring takes long enough once
    EXPECT_EQ(program.run("bench stability --generate 1k").exit_code, 2);
}

TEST_F(Bench, ComparesPrecisionsOfTheTrainedModel) {
    train();
    expect_lines(program.run(std::string("bench precision -m run") + kFew),
                 {"builtin:diffuse, run at iteration 2\n\n", "full"});
    EXPECT_EQ(program.run("bench precision -m run --generate 1k").exit_code, 2);
}

TEST_F(Bench, ASubcommandTakesItsOptionsBehindItsName) {
    const Outcome before = program.run("bench -m run precision");
    EXPECT_EQ(before.exit_code, 2);
    EXPECT_NE(before.err.find("stands before 'precision'"), std::string::npos) << before.err;
    EXPECT_EQ(program.run("bench stability suite densification").exit_code, 2) << "one of them at a time";
    expect_lines(program.run("bench --help"), {"frames", "suite", "precision", "stability"});
}

TEST(Version, NamesTheGpuOrSaysWhyThereIsNone) {
    const Outcome version = Program().run("--version");
    EXPECT_EQ(version.exit_code, 0);
    const bool cuda = version.out.find("backends: cpu, cuda\ndevice: ") != std::string::npos;
    EXPECT_NE(cuda, version.out.find("backends: cpu (cuda: ") != std::string::npos) << version.out;
    if (cuda) {
        EXPECT_NE(version.out.find("driver for CUDA "), std::string::npos) << version.out;
        EXPECT_NE(version.out.find("cuda architectures: "), std::string::npos) << version.out;
    }
}

TEST(Device, AMachineWithoutAGpuSaysSoInOneLine) {
    const Program program;
    if (program.run("--version").out.find(", cuda") != std::string::npos) GTEST_SKIP() << "there is a CUDA device";
    const Outcome outcome = program.run("train -s builtin:diffuse -r 4 --iterations 1 --appearance none -m run");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const auto line = outcome.err.find("device: CPU");
    ASSERT_NE(line, std::string::npos) << outcome.err;
    const std::string text = outcome.err.substr(line, outcome.err.find('\n', line) - line);
    EXPECT_TRUE(text.find("CUDA") != std::string::npos || text.find("(no NVIDIA driver)") != std::string::npos)
        << "the reason is in the line: " << text;
    EXPECT_EQ(outcome.err.find("device: ", line + 1), std::string::npos) << outcome.err;
}

}  // namespace
}  // namespace gs
