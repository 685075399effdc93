// SPDX-License-Identifier: Apache-2.0
// What the program prints where stdout or stderr is a terminal, made by script(1).
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

#include "lib/core/json_text.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Program;

class Terminal : public ::testing::Test {
  protected:
    void SetUp() override {
        if (std::system("command -v script stty >/dev/null 2>&1") != 0) GTEST_SKIP() << "no script(1) or no stty(1)";
    }
    /// Runs a short training with `arguments` and redirections on a terminal of 60 columns. Returns what that showed.
    std::string train(const std::string& arguments, const std::string& environment = "") {
        return shown(
            "train -s builtin:diffuse --device cpu --eval -r 8 --iterations 20 --overwrite -m run " + arguments,
            environment);
    }
    /// Runs the program on such a terminal. Returns what that showed.
    std::string shown(const std::string& arguments, const std::string& environment = "") {
        program_.folder().write("command.sh",
                                "stty cols 60; " + environment + " '" GSAPP_PROGRAM "' " + arguments + "\n");
        const std::string folder = "cd '" + program_.folder().path().string() + "' && ";
        const int status = std::system((folder + "script -qefc 'sh command.sh' /dev/null >terminal.txt").c_str());
        EXPECT_EQ(status, 0) << program_.read("terminal.txt");
        return program_.read("terminal.txt");
    }
    static std::size_t json_lines(const std::string& text) {
        std::istringstream in(text);
        std::size_t count = 0;
        for (std::string line; std::getline(in, line);) count += line.starts_with("{") ? 1 : 0;
        return count;
    }
    Program program_;
};

TEST_F(Terminal, ShowsTheBarAndATableWithoutMarks) {
    const std::string shown = train("");
    EXPECT_EQ(json_lines(shown), 0u) << shown;
    EXPECT_NE(shown.find("20/20 100%"), std::string::npos) << shown;
    EXPECT_NE(shown.find("| run |"), std::string::npos) << shown;
    EXPECT_EQ(shown.find("**"), std::string::npos) << shown;
    EXPECT_NE(shown.find("\033[32m"), std::string::npos) << "levels have colours\n" << shown;
    // Each drawing of the bar stays on its line.
    for (std::size_t at = 0; (at = shown.find("\r\033[K", at)) != std::string::npos;) {
        at += 4;
        const std::string line = shown.substr(at, shown.find_first_of("\r\n", at) - at);
        if (line.find("loss") != std::string::npos) {
            EXPECT_LT(line.size(), 60u) << line;
        }
    }
}

TEST_F(Terminal, TheTableGoesWhereStdoutIsAFileAndTheBarStays) {
    const std::string shown = train(">table.md");
    EXPECT_EQ(json_lines(program_.read("table.md")), 0u);
    EXPECT_NE(program_.read("table.md").find("| run |"), std::string::npos);
    EXPECT_EQ(json_lines(shown), 0u);
    EXPECT_NE(shown.find("20/20 100%"), std::string::npos) << shown;
}

TEST_F(Terminal, JsonLinesGoWhereStdoutIsAFileAndTheBarStays) {
    const std::string shown = train("--json >lines.txt");
    EXPECT_GE(json_lines(program_.read("lines.txt")), 3u);
    EXPECT_EQ(json_lines(shown), 0u);
    EXPECT_NE(shown.find("20/20 100%"), std::string::npos) << shown;
    EXPECT_NE(shown.find("| run |"), std::string::npos) << "the table is for people\n" << shown;
}

TEST_F(Terminal, AFileForMessagesPutsNoJsonOnTheTerminal) {
    const std::string shown = train("2>messages.txt");
    EXPECT_EQ(json_lines(shown), 0u) << shown;
    EXPECT_NE(shown.find("| run |"), std::string::npos) << shown;
    EXPECT_EQ(program_.read("messages.txt").find("20/20 100%"), std::string::npos);
}

TEST_F(Terminal, JsonForcesLines) {
    EXPECT_GE(json_lines(train("--json 2>messages.txt")), 3u);
    EXPECT_NE(program_.read("messages.txt").find("| run |"), std::string::npos);
    EXPECT_GE(json_lines(train("--json --quiet")), 3u);
}

TEST_F(Terminal, NoColorIsRespected) { EXPECT_EQ(train("", "NO_COLOR=1").find("\033[32m"), std::string::npos); }

TEST_F(Terminal, VerboseShowsOptionsAndFiles) {
    program_.folder().write("run.yaml", "seed: 7\n");
    const std::string shown = train("-v -c run.yaml >table.md");
    EXPECT_NE(shown.find("options that are not at their defaults: "), std::string::npos) << shown;
    EXPECT_NE(shown.find("seed 7"), std::string::npos) << shown;
}

TEST_F(Terminal, ShowsTablesOfExperimentsWithoutMarks) {
    const std::string small = " -s builtin:diffuse --device cpu -r 8 --iterations 2 --init-points 500 ";
    for (const std::string& command :
         {"tradeoff --axes appearance=none,nasg -m out" + small, "bench suite densification --appearances none" + small,
          "bench --appearance none --repeat 1 --frame-repeat 1" + small, std::string("eval out/appearance-none")}) {
        const std::string text = shown(command);
        EXPECT_NE(text.find("| ---"), std::string::npos) << command << "\n" << text;
        EXPECT_EQ(text.find("**"), std::string::npos) << command << "\n" << text;
        EXPECT_EQ(text.find("###"), std::string::npos) << command << "\n" << text;
    }
    EXPECT_NE(shown("tradeoff --axes appearance=none,nasg -m out" + small + ">table.md").find("finished before"),
              std::string::npos);
    EXPECT_NE(program_.read("table.md").find("### Trade-off of diffuse"), std::string::npos) << "no terminal";
}

TEST_F(Terminal, EvaluationsStandInTheLog) {
    train("--test-iterations 10 >table.md");
    std::istringstream log(program_.read("run/stats/train.jsonl"));
    std::vector<nlohmann::json> scored;
    for (std::string line; std::getline(log, line);)
        if (const auto json = parse_json(line); json["event"] == "evaluation") scored.push_back(json);
    ASSERT_EQ(scored.size(), 2u);
    EXPECT_EQ(scored[0]["iteration"], 10);
    EXPECT_EQ(scored[1]["iteration"], 20);
    const auto results = parse_json(program_.read("run/results.json"));
    EXPECT_EQ(scored[1]["psnr"], results["ours_20"]["PSNR"]);
    EXPECT_EQ(scored[1]["ssim"], results["ours_20"]["SSIM"]);
    EXPECT_GT(scored[1]["views"], 0);
}

}  // namespace
}  // namespace gs
