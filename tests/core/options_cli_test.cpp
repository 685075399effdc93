// SPDX-License-Identifier: Apache-2.0
// Options on the command line: spellings, precedence over files and defaults, errors.
#include "lib/core/options_cli.h"

#include <gtest/gtest.h>

#include "kernels/base/error.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

using test::TemporaryFolder;

TrainOptions parse(std::vector<std::string> words, const ResolveRules& rules = {}) {
    CLI::App app;
    TrainArguments arguments(app);
    std::reverse(words.begin(), words.end());  // CLI11 takes its vector from the back
    app.parse(words);
    return arguments.resolve(rules);
}

TEST(OptionsCli, DefaultsRemainWithoutFlags) {
    TrainOptions expected;
    expected.source = "s";
    expected = resolve(expected);
    EXPECT_EQ(options_to_yaml(parse({"-s", "s"})), options_to_yaml(expected));
}

TEST(OptionsCli, CommandLineBeatsFileBeatsDefault) {
    TemporaryFolder folder;
    const std::string file = folder.write("run.yaml", "cap-max: 5\nseed: 6\neval: true\nsource: x\n").string();
    const TrainOptions options = parse({"--config", file, "--cap-max", "7"});
    EXPECT_EQ(options.cap_max, 7);
    EXPECT_EQ(options.seed, 6u);
    EXPECT_TRUE(options.eval);
    EXPECT_EQ(options.iterations, 30000);
    EXPECT_EQ(parse({"--cap-max", "7", "-c", file}).cap_max, 7);
    EXPECT_FALSE(parse({"-c", file, "--eval=false"}).eval);
}

TEST(OptionsCli, BuiltInScenesHaveACapOfTheirOwnUnlessItIsNamed) {
    TemporaryFolder folder;
    const std::string file = folder.write("run.yaml", "cap-max: 1000000\nsource: builtin:glossy\n").string();
    EXPECT_EQ(parse({"-s", "scene"}).cap_max, 1000000);
    EXPECT_EQ(parse({"-s", "builtin:glossy"}).cap_max, 100000);
    EXPECT_EQ(parse({"-s", "builtin:glossy", "--cap-max", "1000000"}).cap_max, 1000000);
    EXPECT_EQ(parse({"-s", "builtin:glossy", "--cap-max", "7"}).cap_max, 7);
    EXPECT_EQ(parse({"-c", file}).cap_max, 1000000) << "as a run of another version was begun";
    EXPECT_EQ(parse({"-c", file, "-s", "scene"}).cap_max, 1000000);
}

TEST(OptionsCli, ShortLongAndForeignSpellingsMeanTheSame) {
    for (const char* flag : {"-s", "--source", "--source_path", "--source-path", "--data-path"})
        EXPECT_EQ(parse({flag, "here"}).source, "here") << flag;
    EXPECT_EQ(parse({"here"}).source, "here");
    for (const char* flag : {"-m", "-o", "--model", "--output", "--model_path", "--model-path"}) {
        EXPECT_EQ(parse({"here", flag, "there"}).model, "there") << flag;
    }
    EXPECT_EQ(parse({"here", "-i", "images_4", "-r", "4"}).images, "images_4");
    EXPECT_FALSE(parse({"here", "-r", "-1"}).resolution);
}

TEST(OptionsCli, EveryUnderscoreSpellingIsAccepted) {
    for (const Option& option : train_option_table()) {
        std::string flag = "--" + option.key;
        std::replace(flag.begin() + 2, flag.end(), '-', '_');
        const bool is_switch = std::holds_alternative<bool TrainOptions::*>(option.field);
        const std::string value = option.key == "recipe"          ? "frontier"  // auto stands for another
                                  : option.key == "image-cache"   ? "7MB"       // sizes and durations have units
                                  : option.key == "size-limit"    ? "7MB"
                                  : option.key == "time-limit"    ? "7s"
                                  : option.key == "frame-limit"   ? "7ms"
                                  : !option.choices.empty()       ? option.choices.front()
                                  : !option.max_word.empty()      ? option.max_word
                                  : option.max && *option.max < 1 ? "0.5"
                                  : option.min                    ? "1"
                                                                  : "7";
        std::vector<std::string> words = {flag};
        if (!is_switch) words.push_back(value);
        if (option.key != "source") words.insert(words.begin(), "here");
        if (option.key == "background") words.back() = "white";
        if (option.key == "resume") words.insert(words.end(), {"-m", "there"});
        if (option.key == "ppisp-exif") words.insert(words.end(), {"--ppisp", "on"});
        if (option.key == "speedy-splat") words.insert(words.end(), {"--strategy", "adc"});
        const TrainOptions options = parse(words);
        const std::string expected = is_switch ? "true" : option.key == "background" ? "white" : value;
        const bool is_list = std::holds_alternative<std::vector<std::int64_t> TrainOptions::*>(option.field);
        EXPECT_EQ(option_text(option, options), is_list ? "[" + expected + "]" : expected) << flag;
    }
}

TEST(OptionsCli, A3dgsCommandLineRunsUnchanged) {
    const TrainOptions options = parse({"--source_path",
                                        "scene",
                                        "--model_path",
                                        "out",
                                        "--images",
                                        "images_4",
                                        "--resolution",
                                        "1",
                                        "--white_background",
                                        "--eval",
                                        "--iterations",
                                        "7000",
                                        "--test_iterations",
                                        "3000",
                                        "7000",
                                        "--save_iterations",
                                        "7000",
                                        "--checkpoint_iterations",
                                        "3000",
                                        "--sh_degree",
                                        "2",
                                        "--cap_max",
                                        "50000",
                                        "--lambda_dssim",
                                        "0.3",
                                        "--densify_grad_threshold",
                                        "0.0004",
                                        "--position_lr_init",
                                        "0.0002",
                                        "--start_checkpoint",
                                        "out/c",
                                        "--quiet"});
    EXPECT_EQ(options.source, "scene");
    EXPECT_EQ(background_text(options.background), "white");
    EXPECT_EQ(options.test_iterations, (std::vector<std::int64_t>{3000, 7000}));
    EXPECT_EQ(options.model_options.at("sh-degree"), 2);
    EXPECT_EQ(options.cap_max, 50000);
    EXPECT_EQ(options.lambda_dssim, 0.3);
    EXPECT_EQ(options.densify_grad_threshold, 0.0004);
    EXPECT_EQ(options.position_lr_init, 0.0002);
    EXPECT_EQ(options.resume, "out/c");
    EXPECT_TRUE(options.quiet);
}

TEST(OptionsCli, WhiteBackgroundIsAShorthand) {
    const auto background = [](const std::vector<std::string>& words) {
        return background_text(parse(words).background);
    };
    EXPECT_EQ(background({"here", "-w"}), "white");
    EXPECT_EQ(background({"here", "-w", "--background", "black"}), "white");
    EXPECT_EQ(background({"here", "--background", "0.5,0.5,1"}), "0.5,0.5,1");
}

TEST(OptionsCli, ResumeAloneMeansLatest) {
    EXPECT_EQ(parse({"here", "-m", "out", "--resume"}).resume, "latest");
    EXPECT_EQ(parse({"here", "-m", "out", "--resume", "latest"}).resume, "latest");
    EXPECT_EQ(parse({"here", "-m", "out", "--resume", "file"}).resume, "file");
    EXPECT_EQ(parse({"here", "-m", "out"}).resume, "");
}

TEST(OptionsCli, AnEmptyResumeIsRefused) {
    try {
        parse({"here", "-m", "out", "--resume", ""});
        ADD_FAILURE() << "a training would begin anew";
    } catch (const UsageError& e) {
        EXPECT_NE(std::string(e.what()).find("option resume: its value is empty"), std::string::npos) << e.what();
    }
    EXPECT_EQ(parse({"here", "-m", "out", "--resume="}).resume, "latest") << "as the flag alone";
}

TEST(OptionsCli, ResumedRunKeepsItsOptionsUnlessFlagsChangeThem) {
    TemporaryFolder folder;
    TrainOptions run;
    run.source = "builtin:moved";
    run.cap_max = 77;
    run.overwrite = true;
    folder.write("config.yaml", options_to_yaml(run));
    const TrainOptions options = parse({"-m", folder.path().string(), "--resume", "--iterations", "40000"});
    EXPECT_EQ(options.source, "builtin:moved");
    EXPECT_EQ(options.cap_max, 77);
    EXPECT_EQ(options.iterations, 40000);
    EXPECT_EQ(options.resume, "latest");
    EXPECT_FALSE(options.overwrite);
    EXPECT_THROW(parse({"-m", folder.path().string()}), UsageError) << "a new run does not read the old one's options";
}

TEST(OptionsCli, CommandsOnFinishedRunsReadTheirOptions) {
    TemporaryFolder folder;
    TrainOptions run;
    run.source = "builtin:moved";
    run.cap_max = 77;
    folder.write("config.yaml", options_to_yaml(run));
    const ResolveRules rules = {.stored_run = true, .default_source = "generated"};
    const TrainOptions options = parse({"-m", folder.path().string(), "--deterministic"}, rules);
    EXPECT_EQ(options.source, "builtin:moved");
    EXPECT_EQ(options.cap_max, 77);
    EXPECT_TRUE(options.deterministic);
    EXPECT_EQ(parse({"-m", folder.path().string(), "-s", "other"}, rules).source, "other");
    EXPECT_EQ(parse({}, rules).source, "generated");
}

TEST(OptionsCli, LastOfRepeatedFlagsCounts) {
    EXPECT_EQ(parse({"here", "--cap-max", "1", "--cap-max", "2"}).cap_max, 2);
}

TEST(OptionsCli, TwoSpellingsOfOneOptionContradict) {
    EXPECT_THROW(parse({"here", "--source_path", "there"}), UsageError);
    EXPECT_THROW(parse({"here", "--cap_max", "1", "--cap-max", "2"}), UsageError);
}

TEST(OptionsCli, WrongValuesNameTheFlag) {
    try {
        parse({"here", "--cap-max", "many"});
        FAIL();
    } catch (const UsageError& e) {
        EXPECT_STREQ(e.what(), "--cap-max: 'many' is not a whole number");
    }
    EXPECT_THROW(parse({"here", "--cap-mx", "3"}), CLI::ParseError);
    EXPECT_THROW(parse({"here", "--cap-max"}), CLI::ParseError);
    EXPECT_THROW(parse({}), UsageError);
}

TEST(OptionsCli, HelpHidesForeignSpellingsAndShowsDefaults) {
    CLI::App app;
    TrainArguments arguments(app);
    const std::string help = app.help();
    EXPECT_EQ(help.find("--source_path"), std::string::npos);
    EXPECT_EQ(help.find("--cap_max"), std::string::npos);
    for (const Option& option : train_option_table())
        EXPECT_NE(help.find("--" + option.key), std::string::npos) << option.key;
    EXPECT_NE(help.find("1000000"), std::string::npos);
}

}  // namespace
}  // namespace gs
