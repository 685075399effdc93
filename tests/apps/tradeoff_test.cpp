// SPDX-License-Identifier: Apache-2.0
// `gsapp tradeoff` as a user calls it: all runs, again without training, Ctrl-C and on, a time limit, mistakes.
#include <gtest/gtest.h>
#include <map>
#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "lib/io/image.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

constexpr const char* kTiny = "tradeoff -s builtin:diffuse --device cpu -r 8 --init-points 500 --cap-max 10000 -m out ";

int count(const std::string& text, const std::string& part) {
    int n = 0;
    for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++n;
    return n;
}

int finished(const Program& program) { return count(program.read("out/tradeoff.json"), "\"status\": \"finished\""); }

TEST(TradeoffProgram, ASecondCallKeepsAllRunsAndGivesTheSameResult) {
    const Program program;
    const std::string command = std::string(kTiny) + "--axes appearance=none,sh iterations=2,4";
    const Outcome first = program.run(command);
    ASSERT_EQ(first.exit_code, 0) << first.err;
    EXPECT_EQ(finished(program), 4);
    EXPECT_EQ(program.read("out/tradeoff.md"), first.out);
    for (const char* part : {"**best**: ", "**smallest**: ", "**fastest**: "})
        EXPECT_NE(first.out.find(part), std::string::npos) << first.out;
    EXPECT_NE(program.read("out/tradeoff.html").find("<svg"), std::string::npos);

    const Outcome again = program.run(command);
    ASSERT_EQ(again.exit_code, 0) << again.err;
    EXPECT_EQ(again.out, first.out);
    EXPECT_EQ(count(again.err, "finished before"), 4) << again.err;

    const Outcome json = program.run(command + " --json --quiet");
    ASSERT_EQ(json.exit_code, 0) << json.err;
    EXPECT_EQ(json.out, program.read("out/tradeoff.json"));
    EXPECT_EQ(json.err, "");

    const Outcome other = program.run(command + " -s builtin:glossy");
    EXPECT_EQ(other.exit_code, 2);
    EXPECT_NE(other.err.find("source builtin:diffuse, now builtin:glossy"), std::string::npos) << other.err;
    EXPECT_EQ(program.read("out/tradeoff.md"), first.out) << "nothing is touched";
}

/// Returns a prefix of the program's command that sends the program alone SIGINT as soon as `file` is there.
std::string interrupted_at(const std::string& file) {
    return "sh -c '\"$0\" \"$@\" & p=$!; while kill -0 $p && ! test -e " + file +
           "; do sleep 0.1; done; kill -INT $p; wait $p'";
}

TEST(TradeoffProgram, CtrlCWritesWhatIsThereAndTheSameCommandGoesOn) {
    const Program program;
    // Order: the short one first.
    const std::string axes = "--axes iterations=2,";
    const Outcome stopped =
        program.run(kTiny + axes + "10000000", interrupted_at("out/iterations-10000000/stats/train.jsonl"));
    EXPECT_EQ(stopped.exit_code, 130) << stopped.err;
    EXPECT_EQ(finished(program), 1);
    EXPECT_NE(stopped.out.find("- iterations 10000000: not reached\n"), std::string::npos) << stopped.out;
    EXPECT_NE(stopped.err.find("the same command"), std::string::npos) << stopped.err;
    EXPECT_TRUE(std::filesystem::exists(program.path("out/iterations-10000000/checkpoints")))
        << "the run was told, and saved";

    const Outcome next = program.run(kTiny + axes + "3");
    ASSERT_EQ(next.exit_code, 0) << next.err;
    EXPECT_EQ(count(next.err, "finished before"), 1) << next.err;
    EXPECT_EQ(finished(program), 2);
}

TEST(TradeoffProgram, ATimeLimitStopsAndSkipsAndSaysSo) {
    const Program program;
    const Outcome outcome = program.run(std::string(kTiny) + "--axes iterations=5,4000000,8000000 --time-limit 300s");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(finished(program), 1);
    for (const char* n : {"4000000", "8000000"})
        EXPECT_NE(outcome.out.find("- iterations " + std::string(n) + ": not started: would not have ended in time\n"),
                  std::string::npos)
            << outcome.out;
    EXPECT_NE(outcome.err.find("the time limit left out 2"), std::string::npos) << outcome.err;

    const Outcome none =
        program.run(std::string(kTiny) + "--axes iterations=4000000,8000000 --time-limit 4s --threads 1");
    EXPECT_EQ(none.exit_code, 2) << none.err;
    EXPECT_NE(none.err.find("--time-limit 4s: too short for even one"), std::string::npos) << none.err;
    EXPECT_NE(none.out.find("- iterations 4000000: stopped at the time limit\n"), std::string::npos) << none.out;
}

TEST(TradeoffProgram, HalvingTrainsFewerOfThemLonger) {
    const Program program;
    const Outcome outcome =
        program.run(std::string(kTiny) + "--axes appearance=none,sh,nasg --iterations 8 --search halving");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    std::map<std::string, int> runs;
    const auto json = parse_json(program.read("out/tradeoff.json"));
    for (const auto& run : json["runs"]) ++runs[run["values"]["iterations"]];
    EXPECT_EQ(runs, (std::map<std::string, int>{{"2", 3}, {"4", 2}, {"8", 1}}));
}

TEST(TradeoffProgram, FailuresAreReportedAndTheOthersGoOn) {
    const Program program;
    std::filesystem::create_directory(program.path("out"));
    program.folder().write("out/iterations-2", "a file where the run's folder should be");
    const Outcome one = program.run(std::string(kTiny) + "--axes iterations=2,4");
    EXPECT_EQ(one.exit_code, 3) << one.err;
    EXPECT_EQ(finished(program), 1);
    EXPECT_NE(one.out.find("- iterations 2: failed: "), std::string::npos) << one.out;
    program.folder().write("out/iterations-3", "another");
    const Outcome all = program.run(std::string(kTiny) + "--axes iterations=2,3");
    EXPECT_EQ(all.exit_code, 3) << all.err;
    EXPECT_NE(all.err.find("2 of 2 runs failed"), std::string::npos) << all.err;
    EXPECT_NE(all.out.find("No configuration was trained to its end."), std::string::npos) << all.out;
}

TEST(TradeoffProgram, ABudgetBelowTheScenesPointsIsRemarked) {
    const Program program;
    const Outcome outcome = program.run(std::string(kTiny) + "--iterations 2 --axes budget=0.1,1");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_NE(outcome.out.find("1 of 2 configurations have a --cap-max below the "), std::string::npos) << outcome.out;
}

TEST(TradeoffProgram, AsksForTestViews) {
    const Program program;
    Image image{16, 16, 3, std::vector<std::uint8_t>(16 * 16 * 3, 100), {}};
    for (const char* name : {"a.png", "b.png"}) write_image(program.path(name), image);
    program.folder().write("transforms.json", R"({"fl_x": 16, "w": 16, "h": 16, "frames": [
        {"file_path": "a.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},
        {"file_path": "b.png", "transform_matrix": [[1,0,0,1],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]})");
    const Outcome outcome = program.run("tradeoff -s transforms.json --device cpu --test-every 0 -m out");
    EXPECT_EQ(outcome.exit_code, 3) << outcome.err;
    EXPECT_NE(outcome.err.find("no test views"), std::string::npos) << outcome.err;
    EXPECT_FALSE(std::filesystem::exists(program.path("out")));
}

TEST(TradeoffProgram, MistakesAreFoundBeforeAnythingIsTrained) {
    const Program program;
    const auto message = [&](const std::string& arguments, int exit_code) {
        const Outcome outcome = program.run("tradeoff " + arguments);
        EXPECT_EQ(outcome.exit_code, exit_code) << arguments << "\n" << outcome.err;
        return outcome.err;
    };
    const std::string scene = "-s builtin:diffuse --device cpu -r 8 ";
    EXPECT_NE(message("", 2).find("no scene given"), std::string::npos);
    EXPECT_NE(message(scene + "--axes budgt=1,0.5", 2).find("did you mean 'budget'"), std::string::npos);
    EXPECT_NE(message(scene + "--axes appearance=sh", 2).find("one configuration only"), std::string::npos);
    EXPECT_NE(message(scene + "--axes appearance=sh,sj", 2).find("'sj' is not one of"), std::string::npos);
    EXPECT_NE(message(scene + "--time-limit soon", 2).find("--time-limit: 'soon'"), std::string::npos);
    EXPECT_NE(message(scene + "--resume", 2).find("not resumed"), std::string::npos);
    message(scene + "--quality lpips", 2);
    message(scene + "--give-up -1", 2);
    EXPECT_NE(message("-s nowhere --device cpu", 3).find("nowhere"), std::string::npos);
    EXPECT_FALSE(std::filesystem::exists(program.path("output")));
}

// `gsapp bench suite` as a user calls it: all runs, again without training, a run that fails, Ctrl-C.

constexpr const char* kSuite =
    " --appearances none -s builtin:diffuse --device cpu -r 8 --init-points 500 --cap-max 1000 ";

TEST(Suite, TrainsWhatIsMissingAndTabulatesAll) {
    const Program program;
    const std::string command = std::string("bench suite densification") + kSuite + "--iterations 4 -m out";
    const Outcome first = program.run(command);
    ASSERT_EQ(first.exit_code, 0) << first.err;
    for (const char* row : {"| MCMC               | none  ", "| MCMC 0.1x          | none  ",
                            "| ADC                | none  ", "| ADC + Speedy-Splat | none  "})
        EXPECT_NE(first.out.find(row), std::string::npos) << first.out;
    EXPECT_EQ(program.read("out/suite.md"), first.out);
    EXPECT_EQ(count(program.read("out/suite.json"), "\"status\": \"finished\""), 4);

    const Outcome json = program.run(command + " --json --quiet");
    EXPECT_EQ(json.exit_code, 0) << json.err;
    EXPECT_EQ(json.out, program.read("out/suite.json"));
    EXPECT_EQ(json.err, "");

    const Outcome again = program.run(std::string("bench suite densification") + kSuite + "--iterations 4 -m out");
    EXPECT_EQ(again.exit_code, 0) << again.err;
    EXPECT_EQ(again.out, first.out);
    EXPECT_EQ(count(again.err, "finished before"), 4) << again.err;

    // A run that broke off is trained anew; the others stay.
    std::filesystem::remove(program.path("out/adc-none/results.json"));
    const Outcome repaired = program.run(command);
    EXPECT_EQ(repaired.exit_code, 0) << repaired.err;
    EXPECT_EQ(count(repaired.err, "finished before"), 3) << repaired.err;
    EXPECT_EQ(count(program.read("out/suite.json"), "\"status\": \"finished\""), 4);

    // Runs of other options are not touched.
    const Outcome other = program.run(command + " --seed 5");
    EXPECT_EQ(other.exit_code, 2) << other.err;
    EXPECT_EQ(count(other.out, "failed: "), 4) << other.out;
    EXPECT_NE(other.out.find("--overwrite"), std::string::npos) << other.out;
    EXPECT_EQ(program.run(command).exit_code, 0);
}

TEST(Suite, AFailedRunIsReportedAndTheOthersGoOn) {
    const Program program;
    std::filesystem::create_directory(program.path("out"));
    program.folder().write("out/adc-none", "a file where the run's folder should be");
    const Outcome outcome = program.run(std::string("bench suite densification") + kSuite + "--iterations 2 -m out");
    EXPECT_EQ(outcome.exit_code, 3) << outcome.err;
    EXPECT_EQ(count(outcome.out, ": failed: "), 1) << outcome.out;
    EXPECT_NE(outcome.out.find("- ADC, none: failed: "), std::string::npos) << outcome.out;
    EXPECT_NE(outcome.err.find("1 of 4 runs failed"), std::string::npos) << outcome.err;
    EXPECT_EQ(count(program.read("out/suite.json"), "\"status\": \"finished\""), 3);
}

TEST(Suite, InterruptKeepsFinishedRuns) {
    const Program program;
    const Outcome stopped = program.interrupt(
        std::string("bench suite activations") + kSuite + "--iterations 10000000 -m out", ": training in");
    EXPECT_EQ(stopped.exit_code, 130) << stopped.err;
    EXPECT_EQ(count(stopped.out, ": not trained\n"), 12) << stopped.out;
    EXPECT_NE(stopped.err.find("the same command"), std::string::npos) << stopped.err;
}

TEST(Suite, MistakesAreUsageErrors) {
    const Program program;
    const std::string command = "bench suite ";
    EXPECT_EQ(program.run(command + "everything -s builtin:diffuse").exit_code, 2);
    EXPECT_EQ(program.run(command + "densification").exit_code, 2);
    EXPECT_EQ(program.run(command + "densification -s builtin:diffuse --appearances sj").exit_code, 2);
    EXPECT_EQ(program.run(command + "densification -s builtin:diffuse --generate 1k").exit_code, 2);
    const Outcome positional = program.run(command + "densification nowhere --appearances sh");
    EXPECT_EQ(positional.exit_code, 3) << positional.err;
    EXPECT_NE(positional.out.find("failed: "), std::string::npos) << positional.out;
    std::filesystem::remove_all(program.path("output"));
    EXPECT_EQ(program.run("bench suite -s builtin:diffuse").exit_code, 2);
    EXPECT_EQ(program.run("bench --appearances sh -s builtin:diffuse").exit_code, 2);
    EXPECT_FALSE(std::filesystem::exists(program.path("output")));
}

}  // namespace
}  // namespace gs
