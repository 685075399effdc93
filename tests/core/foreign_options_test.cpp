// SPDX-License-Identifier: Apache-2.0
// Options of other programs: the table, the command line that understands it, and the page about it.
#include "lib/core/foreign_options.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <set>
#include <sstream>

#include "kernels/base/error.h"
#include "lib/core/options_cli.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TrainOptions parse(std::vector<std::string> words) {
    CLI::App app;
    TrainArguments arguments(app);
    std::reverse(words.begin(), words.end());  // CLI11 takes its vector from the back
    app.parse(words);
    return arguments.resolve();
}

const Option* option_of(const std::string& key) {
    const auto& table = train_option_table();
    const auto found = std::find_if(table.begin(), table.end(), [&](const Option& o) { return o.key == key; });
    return found == table.end() ? nullptr : &*found;
}

/// Returns a value that is not the default, and goes with no other option.
std::string value_for(const Option& option) {
    if (option.key == "iterations" || option.key == "seed") return "77";
    if (option.key == "resolution") return "4";
    if (option.key == "background") return "white";
    if (option.key == "device") return "cpu";
    if (!option.choices.empty()) return option.choices.front();
    if (option.min) return *option.max <= 1 ? "0.5" : "2";
    return "there";
}

TEST(ForeignOptions, NameOptionsThatExist) {
    for (const ForeignProgram& program : foreign_programs()) {
        std::set<std::string> names;
        for (const ForeignOption& foreign : program.options) {
            EXPECT_TRUE(names.insert(foreign.name).second) << foreign.name;
            const bool has_counterpart = foreign.use == ForeignUse::kSynonym || foreign.use == ForeignUse::kSets;
            EXPECT_EQ(option_of(foreign.key) != nullptr, has_counterpart) << foreign.name;
            EXPECT_TRUE(has_counterpart || !foreign.note.empty()) << foreign.name << " needs a reason";
        }
    }
}

TEST(ForeignOptions, EverySpellingDoesWhatTheTableSays) {
    std::set<std::string> seen;  // of two programs' options of one name the first counts
    for (const ForeignProgram& program : foreign_programs())
        for (const ForeignOption& foreign : program.options)
            for (const std::string& name : spellings(foreign)) {
                if (!seen.insert(name).second) continue;
                std::vector<std::string> words = {name};
                const Option* option = option_of(foreign.key);
                const bool is_switch = option && std::holds_alternative<bool TrainOptions::*>(option->field);
                std::string expected = foreign.value;
                if (foreign.use == ForeignUse::kSynonym) {
                    expected = is_switch ? "true" : value_for(*option);
                    if (!is_switch) words.push_back(expected);
                    if (std::holds_alternative<std::vector<std::int64_t> TrainOptions::*>(option->field)) {
                        words.push_back("7");
                        expected = "[" + expected + ", 7]";
                    }
                } else if (foreign.use != ForeignUse::kSets && !foreign.is_switch) {
                    words.push_back("5");
                }
                if (foreign.key != "source") words.insert(words.end(), {"--source", "here"});
                if (foreign.use == ForeignUse::kMissing) {
                    try {
                        parse(words);
                        ADD_FAILURE() << name;
                    } catch (const UsageError& e) {
                        EXPECT_EQ(e.what(), foreign.name + " of " + program.name + ": not yet: " + foreign.note);
                    }
                    continue;
                }
                const TrainOptions options = parse(words);
                if (option) {
                    EXPECT_EQ(option_text(*option, options), expected) << name;
                }
                if (foreign.use == ForeignUse::kIgnored) {
                    TrainOptions plain = parse({"--source", "here"});
                    EXPECT_EQ(options_to_yaml(options), options_to_yaml(plain)) << name;
                }
            }
}

TEST(ForeignOptions, ValuesThatAskForNothingAreAccepted) {
    for (const ForeignProgram& program : foreign_programs())
        for (const ForeignOption& foreign : program.options)
            if (foreign.use == ForeignUse::kMissing && !foreign.is_switch) {
                EXPECT_NO_THROW(parse({"--source", "here", foreign.name, foreign.value})) << foreign.name;
            }
    EXPECT_NO_THROW(parse({"--source", "here", "--train_test_exp=false"}));
}

TEST(ForeignOptions, NumbersThatAskForNothingMayBeSpelledOtherwise) {
    EXPECT_NO_THROW(parse({"--source", "here", "--steps_scaler", "1.0", "--init_scale", "1"}));
    EXPECT_THROW(parse({"--source", "here", "--steps_scaler", "0.25"}), UsageError);
}

TEST(ForeignOptions, MinusOneInAListOfIterationsIsNone) {
    const TrainOptions options = parse({"--source", "here", "--test_iterations", "-1", "--ply_steps", "-1"});
    EXPECT_TRUE(options.test_iterations.empty());
    EXPECT_TRUE(parse({"-s", "here", "--save_iterations", "-1", "--quiet"}).save_iterations.empty());
    EXPECT_EQ(parse({"-s", "here", "--save_steps", "-1", "7"}).checkpoint_iterations, std::vector<std::int64_t>{7});
    EXPECT_THROW(parse({"-s", "here", "--test_iterations", "-2"}), UsageError);
}

TEST(ForeignOptions, CommandsOfOtherProgramsStandForOptions) {
    const auto parse_line = [](std::vector<std::string> words) {
        words = with_foreign_command(std::move(words));
        EXPECT_EQ(words.front(), "train");
        words.erase(words.begin());
        return parse(std::move(words));
    };
    const TrainOptions mcmc = parse_line({"train", "mcmc", "--data_dir", "here", "--eval_steps", "-1"});
    EXPECT_EQ(mcmc.source, "here");
    EXPECT_EQ(mcmc.strategy, Strategy::kMcmc);
    EXPECT_TRUE(mcmc.eval);
    EXPECT_EQ(mcmc.resolution, 4);
    const TrainOptions adc = parse_line({"train", "default", "--data_dir", "here", "--data_factor", "2"});
    EXPECT_EQ(adc.strategy, Strategy::kAdc);
    EXPECT_EQ(adc.resolution, 2);
    EXPECT_EQ(parse_line({"train", "default", "-s", "here", "-r", "1", "--strategy", "mcmc"}).strategy,
              Strategy::kMcmc);
    const TrainOptions splatfacto =
        parse_line({"train", "splatfacto", "--vis", "viewer", "colmap", "--data", "here", "--downscale-factor", "8"});
    EXPECT_EQ(splatfacto.strategy, Strategy::kAdc);
    EXPECT_EQ(splatfacto.resolution, 8);
    EXPECT_THROW(parse_line({"train", "splatfacto-big", "--data", "here"}), UsageError);
    EXPECT_EQ(parse_line({"train", "here", "-m", "mcmc"}).source, "here");
    EXPECT_EQ(with_foreign_command({"eval", "mcmc"}), (std::vector<std::string>{"eval", "mcmc"}));
    const test::TemporaryFolder folder;
    const std::string scene = folder.write("mcmc", "").string();
    EXPECT_EQ(parse_line({"train", scene}).source, scene);
}

/// Lines of full_eval.py, of gsplat's examples/benchmarks and of nerfstudio's documentation.
TEST(ForeignOptions, LinesOfPublishedScriptsAreTakenOrNameAnOption) {
    const auto parse_line = [](const std::string& line) {
        std::istringstream in("train " + line);
        std::vector<std::string> words{std::istream_iterator<std::string>(in), {}};
        words = with_foreign_command(std::move(words));
        words.erase(words.begin());
        return parse(std::move(words));
    };
    for (const char* line :
         {"-s tandt/truck -m ./eval/truck --quiet --eval --test_iterations -1",
          "-s 360/garden -i images_4 -m ./eval/garden --quiet --eval --test_iterations -1 --optimizer_type sparse_adam",
          "default --eval_steps -1 --disable_viewer --data_factor 4 --render_traj_path ellipse --data_dir "
          "data/360_v2/garden/ --result_dir results/benchmark/garden/",
          "mcmc --eval_steps -1 --disable_viewer --data_factor 2 --strategy.cap-max 1000000 --render_traj_path ellipse "
          "--data_dir data/360_v2/room/ --result_dir results/room/",
          "splatfacto --data here", "splatfacto --data here --max-num-iterations 7000 --vis viewer+tensorboard",
          "splatfacto --pipeline.model.cull_alpha_thresh=0.005 "
          "--pipeline.model.continue_cull_post_densification=False --data here",
          "splatfacto --max-num-iterations 2000 --vis tensorboard --viewer.quit-on-train-completion True colmap --data "
          ". --images-path images --downscale-factor 1 --colmap-path sparse/0"})
        EXPECT_NO_THROW(parse_line(line)) << line;
    for (const auto& [line, named] :
         {std::pair{"mcmc --data_dir a --result_dir b --lpips_net vgg --compression png --ckpt b/ckpt_29999_rank0.pt",
                    "gsapp"},
          {"mcmc --data_dir a --with_eval3d --with_ut", "to first order"},
          {"default --data_dir a --steps_scaler 0.25 --packed", "--iterations"},
          {"splatfacto --pipeline.model.use_scale_regularization True --data a", "--scale-reg"},
          {"splatfacto-big --data a", "--densify-grad-threshold"}}) {
        try {
            parse_line(line);
            ADD_FAILURE() << line;
        } catch (const UsageError& e) {
            EXPECT_NE(std::string(e.what()).find(named), std::string::npos) << e.what();
        }
    }
}

TEST(ForeignOptions, BackgroundsOf3dgsDoNotMix) {
    EXPECT_THROW(parse({"here", "-w", "--random_background"}), UsageError) << "random in training, scored on white";
    EXPECT_EQ(background_text(parse({"here", "--random_background", "--random_bkgd"}).background), "random");
}

TEST(ForeignOptions, DocumentationPageIsUpToDate) {
    std::ifstream file(std::filesystem::path(GSAPP_SOURCE_DIR) / "docs/coming-from.md");
    ASSERT_TRUE(file) << "docs/coming-from.md is missing";
    std::ostringstream text;
    text << file.rdbuf();
    EXPECT_EQ(text.str(), coming_from_markdown()) << "run: gsapp options --coming-from > docs/coming-from.md";
}

}  // namespace
}  // namespace gs
