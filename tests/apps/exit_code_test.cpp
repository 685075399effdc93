// SPDX-License-Identifier: Apache-2.0
// What the program answers to wrong calls: one message, the documented exit code, nothing on stdout, no files.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>

#include "tests/apps/program.h"
#include "tests/eval/support/tiny_run.h"

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
    const Outcome help = program.run("train --help"), all = program.run("train --help-all");
    EXPECT_EQ(help.exit_code, 0);
    EXPECT_EQ(all.exit_code, 0);
    for (const char* command : {"", "train", "eval", "render", "export", "view", "prepare", "bench", "bench frames",
                                "bench suite", "bench precision", "tradeoff", "metrics"}) {
        const std::string text = program.run(std::string(command) + " --help").out;
        EXPECT_LE(std::count(text.begin(), text.end(), '\n'), 40) << "one screen\n" << text;
    }
    for (std::size_t at = 0; at < help.out.size(); at = help.out.find('\n', at) + 1)
        EXPECT_LE(help.out.find('\n', at) - at, 100u) << help.out.substr(at, 120);
    for (const char* basic : {"--iterations", "--cap-max", "--time-limit", "Examples:", "--help-all"})
        EXPECT_NE(help.out.find(basic), std::string::npos) << basic << "\n" << help.out;
    for (const char* other : {"--scaling-lr", "--opacity-reset-interval", "Densification:"}) {
        EXPECT_EQ(help.out.find(other), std::string::npos) << other;
        EXPECT_NE(all.out.find(other), std::string::npos) << other;
    }
    EXPECT_NE(program.run("train --scaling-lrr 1").err.find("did you mean '--scaling-lr'"), std::string::npos);
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

TEST(ExitCode, AWrongCommandLineNamesTheHelpOfItsCommand) {
    const Program program;
    EXPECT_NE(program.run("export run").err.find("\nTry 'gsapp export --help'."), std::string::npos);
    EXPECT_NE(program.run("bench frames --wrong").err.find("\nTry 'gsapp bench frames --help'."), std::string::npos);
    EXPECT_NE(program.run("--wrong").err.find("\nTry 'gsapp --help'."), std::string::npos);
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
    program.folder().write("transforms.json", "{\"frames\": []}");
    expect_refusal(program, "train -s . -i pictures -m run", 3, "image folder 'pictures' does not exist");
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

TEST(ExitCode, TooFewThreadsAreADeviceError) {
    const Program program;
    // Limits of processes do not bind root.
    const std::string as_other = "setpriv --reuid 64321 --clear-groups ";
    if (std::system((as_other + "prlimit --nproc=1 test -x '" GSAPP_PROGRAM "' 2>/dev/null").c_str()) != 0)
        GTEST_SKIP() << "this user cannot become another one that may run the program";
    const auto bench = [&](int threads, int limit) {
        return program.run(
            "bench --generate 50 --repeat 1 --frame-repeat 1 --device cpu --threads " + std::to_string(threads),
            as_other + "prlimit --nproc=" + std::to_string(limit));
    };
    for (const int limit : {1, 3, 6, 12}) {  // some libraries start threads before the program does
        const Outcome outcome = bench(16, limit);
        EXPECT_EQ(outcome.exit_code, 4) << limit << "\n" << outcome.err;
        EXPECT_NE(outcome.err.find("error: the system gives "), std::string::npos) << outcome.err;
    }
    EXPECT_NE(bench(16, 12).err.find("of 16 threads"), std::string::npos);
    EXPECT_NE(bench(16, 12).err.find("--threads"), std::string::npos);
    const Outcome alone = bench(1, 12);
    EXPECT_EQ(alone.exit_code, 0) << alone.err;
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

TEST(ExitCode, AnEmptyResumeIsNoNewRun) {
    const Program program;
    expect_refusal(program, "train -s builtin:diffuse -m run --resume ''", 2, "option resume: its value is empty");
    EXPECT_FALSE(std::filesystem::exists(program.path("run")));
}

/// 5 is for a training alone whose numbers do not stay finite (tests/train/trainer_test.cpp).
TEST(ExitCode, OptionsThatLeaveNothingToSeeAreUsageErrors) {
    const Program program;
    const Outcome outcome = program.run(
        "train -s builtin:diffuse --device cpu -r 8 --iterations 60 --opacity-lr 10 --opacity-reg 10 -m run");
    EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
    EXPECT_NE(outcome.err.find("no Gaussian is visible"), std::string::npos) << outcome.err;
}

TEST(ExitCode, AModelThatIsNotFiniteIsADatasetError) {
    const Program program;
    const std::filesystem::path file = program.path("model.ply");
    write_ply(file, test::one_gaussian(), {});
    std::fstream last(file, std::ios::in | std::ios::out | std::ios::binary);
    last.seekp(-4, std::ios::end);
    last.write("\0\0\xC0\x7F", 4);  // NaN
    last.close();
    for (const char* format : {"web", "ply", "splat"}) {
        const Outcome outcome = program.run(std::string("export model.ply -o site --format ") + format);
        EXPECT_EQ(outcome.exit_code, 3) << outcome.err;
    }
}

TEST(ExitCode, CudaIsNotAvailable) {
    const Program program;
    if (program.run("--version").out.find(", cuda") != std::string::npos) GTEST_SKIP() << "there is a CUDA device";
    expect_refusal(program, "train -s builtin:diffuse -m run --device cuda", 4, "--device cpu");
}

/// Every way to name a file or folder that is read, with @ in its place.
const char* const kInputs[] = {"train -s @ -m run",
                               "train -s builtin:diffuse --config @",
                               "train -s builtin:diffuse -m run --resume @",
                               "train -s builtin:diffuse -m @ --resume",
                               "train -s builtin:@.yaml -m run",
                               "train -s builtin:diffuse --config parent.yaml",
                               "eval @",
                               "render @",
                               "export @ -o out",
                               "bench @",
                               "bench frames @",
                               "metrics @ a.png",
                               "view @"};

std::string with_name(std::string arguments, const std::string& name) {
    if (const auto at = arguments.find('@'); at != std::string::npos) arguments.replace(at, 1, name);
    return arguments;
}

/// A refusal for a reason that lies in a file: code 2 or 3, and the message names it.
void expect_named(const Program& program, const std::string& arguments, const std::string& name) {
    const Outcome outcome = program.run(arguments, "timeout 60");
    EXPECT_TRUE(outcome.exit_code == 2 || outcome.exit_code == 3)
        << arguments.substr(0, 80) << " ended with " << outcome.exit_code << "\n"
        << outcome.err;
    EXPECT_NE(outcome.err.find(name), std::string::npos) << arguments.substr(0, 80) << "\n" << outcome.err;
}

TEST(ExitCode, NamesTooLongAndLoopsOfLinksAreNamed) {
    const Program program;
    std::filesystem::create_symlink("loop", program.path("loop"));
    std::filesystem::create_symlink("loop.yaml", program.path("loop.yaml"));
    program.folder().write("parent.yaml", "parent: loop\n");
    for (const char* arguments : kInputs) expect_named(program, with_name(arguments, "loop"), "loop");
    const std::string name(300, 'x');
    program.folder().write("parent.yaml", "parent: " + name + "\n");
    for (const char* arguments : {"train -s builtin:diffuse --config parent.yaml", "eval @", "export @ -o out"})
        expect_named(program, with_name(arguments, name), name);
}

TEST(ExitCode, PipesAndDevicesAreRefusedWithoutWaiting) {
    const Program program;
    program.folder().write("parent.yaml", "parent: pipe\n");
    ASSERT_EQ(::mkfifo(program.path("pipe").c_str(), 0666), 0);
    ASSERT_EQ(::mkfifo(program.path("pipe.yaml").c_str(), 0666), 0);
    for (const char* arguments : {"train -s @ -m run", "train -s builtin:diffuse --config @",
                                  "train -s builtin:diffuse -m run --resume @", "metrics @ a.png"})
        expect_named(program, with_name(arguments, "pipe"), "pipe");
    expect_named(program, "train -s builtin:diffuse --config /dev/zero", "/dev/zero");
    expect_named(program, "train -s builtin:diffuse --config parent.yaml", "pipe");
    expect_named(program, "train -s builtin:pipe.yaml -m run", "pipe.yaml");
}

TEST(ExitCode, NumbersAreDecimal) {
    const Program program;
    for (const char* number : {"0x10", "010", "nan"})
        expect_refusal(program, std::string("train -s builtin:diffuse --eval --time-frames ") + number, 2, number);
    expect_refusal(program, "render run --orbit 0x10", 2, "0x10");
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
