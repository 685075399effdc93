// SPDX-License-Identifier: Apache-2.0
// What the program answers to wrong calls: one message, the documented exit code, nothing on stdout, no files.
#include <gtest/gtest.h>

#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

void expect_refusal(const Program& program, const std::string& arguments, int exit_code, const std::string& message) {
    const Outcome outcome = program.run(arguments);
    EXPECT_EQ(outcome.exit_code, exit_code) << arguments << "\n" << outcome.err;
    EXPECT_NE(outcome.err.find(message), std::string::npos) << arguments << "\n" << outcome.err;
    EXPECT_EQ(outcome.out, "") << arguments;
    const auto errors = outcome.err.find("error: ");
    ASSERT_NE(errors, std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find("error: ", errors + 1), std::string::npos) << "more than one message:\n" << outcome.err;
}

TEST(ExitCode, HelpAndVersionAreNoErrors) {
    const Program program;
    EXPECT_EQ(program.run("--help").exit_code, 0);
    EXPECT_EQ(program.run("train --help").exit_code, 0);
    const Outcome version = program.run("--version");
    EXPECT_EQ(version.exit_code, 0);
    EXPECT_EQ(version.out.rfind("gsapp ", 0), 0u) << version.out;
    EXPECT_NE(version.out.find("backends: cpu"), std::string::npos);
}

TEST(ExitCode, UnknownWordsNameTheNearest) {
    const Program program;
    expect_refusal(program, "", 2, "subcommand is required");
    expect_refusal(program, "tarin -s x", 2, "unknown command 'tarin'; did you mean 'train'?");
    expect_refusal(program, "train -s x --itertions 5", 2,
                   "unknown option '--itertions'; did you mean '--iterations'?");
    expect_refusal(program, "train -s x --cap-mx=5", 2, "unknown option '--cap-mx'; did you mean '--cap-max'?");
    expect_refusal(program, "eval --frmat csv", 2, "unknown option '--frmat'; did you mean '--format'?");
}

TEST(ExitCode, WrongValuesAreUsageErrors) {
    const Program program;
    expect_refusal(program, "train", 2, "option source");
    expect_refusal(program, "train -s x --cap-max many", 2, "--cap-max: 'many' is not a whole number");
    expect_refusal(program, "train -s x --sh-degree 7", 2, "option sh-degree: 7 is out of range (0..3)");
    expect_refusal(program, "train -s builtin:nothing -m run", 2, "builtin:nothing");
    expect_refusal(program, "train -s x --config missing.yaml", 2, "missing.yaml");
    program.folder().write("bad.yaml", "cap-max: 5\ncap-mx: 5\n");
    expect_refusal(program, "train -s x --config bad.yaml", 2,
                   "bad.yaml:2: unknown key 'cap-mx'; the nearest known key is 'cap-max'");
    EXPECT_FALSE(std::filesystem::exists(program.path("run")));
}

TEST(ExitCode, MissingSceneIsADatasetErrorAndLeavesNothing) {
    const Program program;
    expect_refusal(program, "train -s nowhere -m run", 3, "nowhere");
    expect_refusal(program, "train -s .", 3, "");
    EXPECT_FALSE(std::filesystem::exists(program.path("run")));
    EXPECT_FALSE(std::filesystem::exists(program.path("output")));
}

TEST(ExitCode, FolderOfAnotherRunIsRefusedAndLeftAsItIs) {
    const Program program;
    std::filesystem::create_directory(program.path("run"));
    program.folder().write("run/config.yaml", "seed: 1\n");
    expect_refusal(program, "train -s builtin:diffuse -m run", 2, "--overwrite");
    EXPECT_EQ(program.read("run/config.yaml"), "seed: 1\n");
}

TEST(ExitCode, OutputThatCannotBeWrittenIsADatasetError) {
    const Program program;
    program.folder().write("file", "");
    expect_refusal(program, "train -s builtin:diffuse -m file/run", 3, "file/run");
}

TEST(ExitCode, RunFolderThatIsNoneIsADatasetError) {
    const Program program;
    expect_refusal(program, "eval .", 3, "config.yaml");
    expect_refusal(program, "train -m . --resume -s builtin:diffuse", 3, "");
}

TEST(ExitCode, CudaIsNotAvailable) {
    const Program program;
    if (program.run("--version").out.find(", cuda") != std::string::npos) GTEST_SKIP() << "there is a CUDA device";
    expect_refusal(program, "train -s builtin:diffuse -m run --device cuda", 4, "--device cpu");
}

TEST(OptionsCommand, PrintsYamlThatTrainReads) {
    const Program program;
    const Outcome options = program.run("options");
    EXPECT_EQ(options.exit_code, 0);
    program.folder().write("defaults.yaml", options.out);
    expect_refusal(program, "train -c defaults.yaml -s nowhere -m run", 3, "nowhere");
}

}  // namespace
}  // namespace gs
