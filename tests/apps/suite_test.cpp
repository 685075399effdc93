// SPDX-License-Identifier: Apache-2.0
// `gsapp bench suite` as a user calls it: all runs, again without training, a run that fails, Ctrl-C.
#include <gtest/gtest.h>

#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

constexpr const char* kTiny =
    " --appearances none -s builtin:diffuse --device cpu -r 8 --init-points 500 --cap-max 1000 ";

std::size_t occurrences(const std::string& text, const std::string& part) {
    std::size_t n = 0;
    for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++n;
    return n;
}

TEST(Suite, TrainsWhatIsMissingAndTabulatesAll) {
    const Program program;
    const std::string command = std::string("bench suite densification") + kTiny + "--iterations 4 -m out";
    const Outcome first = program.run(command);
    ASSERT_EQ(first.exit_code, 0) << first.err;
    for (const char* row : {"| MCMC               | none  ", "| MCMC 0.1x          | none  ",
                            "| ADC                | none  ", "| ADC + Speedy-Splat | none  "})
        EXPECT_NE(first.out.find(row), std::string::npos) << first.out;
    EXPECT_EQ(program.read("out/suite.md"), first.out);
    EXPECT_EQ(occurrences(program.read("out/suite.json"), "\"status\": \"finished\""), 4u);

    const Outcome json = program.run(command + " --json --quiet");
    EXPECT_EQ(json.exit_code, 0) << json.err;
    EXPECT_EQ(json.out, program.read("out/suite.json"));
    EXPECT_EQ(json.err, "");

    const Outcome again = program.run(std::string("bench suite densification") + kTiny + "--iterations 4 -m out");
    EXPECT_EQ(again.exit_code, 0) << again.err;
    EXPECT_EQ(again.out, first.out);
    EXPECT_EQ(occurrences(again.err, "finished before"), 4u) << again.err;

    // A run that broke off is trained anew; the others stay.
    std::filesystem::remove(program.path("out/adc-none/results.json"));
    const Outcome repaired = program.run(command);
    EXPECT_EQ(repaired.exit_code, 0) << repaired.err;
    EXPECT_EQ(occurrences(repaired.err, "finished before"), 3u) << repaired.err;
    EXPECT_EQ(occurrences(program.read("out/suite.json"), "\"status\": \"finished\""), 4u);

    // Runs of other options are not touched.
    const Outcome other = program.run(command + " --seed 5");
    EXPECT_EQ(other.exit_code, 2) << other.err;
    EXPECT_EQ(occurrences(other.out, "failed: "), 4u) << other.out;
    EXPECT_NE(other.out.find("--overwrite"), std::string::npos) << other.out;
    EXPECT_EQ(program.run(command).exit_code, 0);
}

TEST(Suite, AFailedRunIsReportedAndTheOthersGoOn) {
    const Program program;
    std::filesystem::create_directory(program.path("out"));
    program.folder().write("out/adc-none", "a file where the run's folder should be");
    const Outcome outcome = program.run(std::string("bench suite densification") + kTiny + "--iterations 2 -m out");
    EXPECT_EQ(outcome.exit_code, 3) << outcome.err;
    EXPECT_EQ(occurrences(outcome.out, ": failed: "), 1u) << outcome.out;
    EXPECT_NE(outcome.out.find("- ADC, none: failed: "), std::string::npos) << outcome.out;
    EXPECT_NE(outcome.err.find("1 of 4 runs failed"), std::string::npos) << outcome.err;
    EXPECT_EQ(occurrences(program.read("out/suite.json"), "\"status\": \"finished\""), 3u);
}

TEST(Suite, InterruptKeepsFinishedRuns) {
    const Program program;
    const Outcome stopped = program.interrupt(
        std::string("bench suite activations") + kTiny + "--iterations 10000000 -m out", ": training in");
    EXPECT_EQ(stopped.exit_code, 130) << stopped.err;
    EXPECT_EQ(occurrences(stopped.out, ": not trained\n"), 12u) << stopped.out;
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
