// SPDX-License-Identifier: Apache-2.0
// The table of options: complete, checked by range, and the same in the code, in the docs and in the scene files.
#include "lib/core/options.h"

#include <gtest/gtest.h>

#include <functional>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "appearance/model_info.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

TrainOptions with_source() {
    TrainOptions options;
    options.source = "builtin:glossy";
    return options;
}

const Option& find(const std::string& key) {
    for (const Option& option : train_option_table()) {
        if (option.key == key) return option;
    }
    throw std::runtime_error("no option " + key);
}

/// Returns the message of the UsageError that `validate` throws; empty when it throws nothing.
std::string complaint(const std::string& key, const std::string& value) {
    TrainOptions options = with_source();
    try {
        set_option(options, find(key), {value}, "--" + key);
        options = resolve(options);
    } catch (const UsageError& e) {
        return e.what();
    }
    return "";
}

TEST(Options, EveryOneHasHelpRangeAndUniqueSpellings) {
    std::set<std::string> names;
    for (const Option& option : train_option_table()) {
        EXPECT_FALSE(option.help.empty()) << option.key;
        EXPECT_FALSE(option.group.empty()) << option.key;
        EXPECT_FALSE(option_range(option).empty()) << option.key;
        EXPECT_EQ(option.key.find('_'), std::string::npos) << option.key;
        EXPECT_TRUE(names.insert("--" + option.key).second) << option.key;
        for (const std::string& name : option.names) EXPECT_TRUE(names.insert(name).second) << name;
        const bool is_switch = std::holds_alternative<bool TrainOptions::*>(option.field);
        EXPECT_TRUE(is_switch || !option.values.empty() || !option.choices.empty() || (option.min && option.max))
            << option.key;
    }
}

TEST(Options, ThoseOfAnExperimentSayWhatTheyGive) {
    for (const Option& option : train_option_table())
        EXPECT_EQ(option.measured.empty(), option.scope != Scope::kExperiment) << option.key;
}

TEST(Options, SpeedySplatGoesWithAdcAndRaisesTheOpacityRate) {
    EXPECT_NE(complaint("speedy-splat", "true").find("option speedy-splat: goes with strategy adc, not with mcmc"),
              std::string::npos);
    TrainOptions options = with_source();
    options.strategy = Strategy::kNone, options.speedy_splat = true;
    EXPECT_THROW(resolve(options), UsageError);
    options.strategy = Strategy::kAdc;
    options = resolve(options);
    EXPECT_EQ(options.opacity_lr, 0.05);
    options.speedy_splat = false;
    options = resolve(options);
    EXPECT_EQ(options.opacity_lr, 0.025);
    options.opacity_lr = 0.01, options.named = {"opacity-lr"};
    options = resolve(options);
    EXPECT_EQ(options.opacity_lr, 0.01) << "a rate that was given stays";
}

TEST(Options, TableCoversTheWholeStruct) {
    // The fields of the table, laid over the struct, leave no gap that is larger than padding: a field that only the
    // struct knows would be one.
    TrainOptions options;
    std::vector<std::pair<std::size_t, std::size_t>> places;  // begin, end
    for (const Option& option : train_option_table()) {
        std::visit(
            [&](const auto& field) {
                if constexpr (!std::is_same_v<std::decay_t<decltype(field)>, ModelOptionField>) {
                    const auto begin = std::size_t(reinterpret_cast<const char*>(&(options.*field)) -
                                                   reinterpret_cast<const char*>(&options));
                    places.emplace_back(begin, begin + sizeof(options.*field));
                }
            },
            option.field);
    }
    const auto models =
        std::size_t(reinterpret_cast<const char*>(&options.model_options) - reinterpret_cast<const char*>(&options));
    places.emplace_back(models, models + sizeof options.model_options);  // all options of models together
    const auto named =
        std::size_t(reinterpret_cast<const char*>(&options.named) - reinterpret_cast<const char*>(&options));
    places.emplace_back(named, named + sizeof options.named);  // says which of the others were set
    std::sort(places.begin(), places.end());
    places.emplace_back(sizeof(TrainOptions), 0);
    std::size_t end = 0;
    for (const auto& [begin, next_end] : places) {
        EXPECT_GE(begin, end) << "two entries share a field";
        EXPECT_LT(begin - end, alignof(TrainOptions)) << "no entry for the field at byte " << end;
        end = next_end;
    }
}

TEST(Options, ModelsDeclareTheirOwn) {
    for (const ModelInfo* model : appearance_models()) {
        for (const ModelOption& option : model->options) {
            const auto& table = train_option_table();
            const auto entry =
                std::find_if(table.begin(), table.end(), [&](const Option& o) { return o.key == option.key; });
            ASSERT_NE(entry, table.end()) << option.key;
            EXPECT_EQ(entry->help, option.help) << "two models that share a key declare the same option";
            EXPECT_EQ(TrainOptions{}.model_options.at(option.key), option.default_value);
        }
        EXPECT_TRUE(model->degree_option.empty() || TrainOptions{}.model_options.count(model->degree_option))
            << model->name;
    }
    const std::string text = complaint("sh-degree", "1.5");
    EXPECT_NE(text.find("a whole number"), std::string::npos) << text;
}

TEST(Options, DefaultsAreValid) {
    TrainOptions options = with_source();
    EXPECT_NO_THROW(resolve(options));
}

TEST(Options, NumbersOutsideTheirRangeAreNamed) {
    for (const Option& option : train_option_table()) {
        if (!option.max) continue;
        const std::string text = complaint(option.key, "99999999999");
        if (std::holds_alternative<int TrainOptions::*>(option.field) ||
            std::holds_alternative<std::optional<int> TrainOptions::*>(option.field)) {
            EXPECT_NE(text.find("a number this option can hold"), std::string::npos) << option.key << ": " << text;
        } else {
            EXPECT_NE(text.find("option " + option.key), std::string::npos) << text;
            EXPECT_NE(text.find(option_range(option)), std::string::npos) << text;
        }
    }
    EXPECT_EQ(complaint("lambda-dssim", "-0.1"), "option lambda-dssim: -0.1 is out of range (0..1)");
    EXPECT_EQ(complaint("sh-degree", "4"), "option sh-degree: 4 is out of range (0..3)");
    EXPECT_EQ(complaint("test-iterations", "0"), "option test-iterations: 0 is out of range (1..2147483647)");
}

TEST(Options, WordsOutsideTheirChoicesAreNamed) {
    EXPECT_EQ(complaint("strategy", "mcm"), "--strategy: 'mcm' is not one of mcmc, adc, none");
    EXPECT_EQ(complaint("strategy", "adc"), "");
    EXPECT_NE(complaint("appearance", "phong").find("is not one of"), std::string::npos);
}

TEST(Options, TextsOfTheWrongTypeAreNamed) {
    EXPECT_EQ(complaint("cap-max", "many"), "--cap-max: 'many' is not a whole number");
    EXPECT_EQ(complaint("cap-max", "1.5"), "--cap-max: '1.5' is not a whole number");
    EXPECT_EQ(complaint("cap-max", ""), "--cap-max: '' is not a whole number");
    EXPECT_EQ(complaint("scaling-lr", "nan"), "--scaling-lr: 'nan' is not a finite number");
    EXPECT_EQ(complaint("scaling-lr", "1e-3x"), "--scaling-lr: '1e-3x' is not a finite number");
    EXPECT_EQ(complaint("seed", "-1"), "--seed: '-1' is not a whole number from 0 upwards");
    EXPECT_EQ(complaint("eval", "maybe"), "--eval: 'maybe' is not true or false");
}

TEST(Options, ResolutionIsDivisorOrWidth) {
    for (const char* good : {"-1", "1", "2", "4", "8", "16", "1600"})
        EXPECT_EQ(complaint("resolution", good), "") << good;
    for (const char* bad : {"0", "3", "5", "15"})
        EXPECT_NE(complaint("resolution", bad).find("option resolution"), std::string::npos) << bad;
}

TEST(Options, BackgroundIsParsed) {
    EXPECT_TRUE(parse_background("black")->always(0, 0, 0));
    EXPECT_TRUE(parse_background("white")->always(1, 1, 1));
    EXPECT_TRUE(parse_background("0.25,0,1")->always(0.25f, 0, 1));
    EXPECT_TRUE(parse_background("random")->random());
    EXPECT_FALSE(parse_background("random")->always(0, 0, 0)) << "black is only what evaluation takes";
    for (const char* bad : {"grey", "", "1,1", "1,1,1,1", "0,0,2", "0,0,nan", "0, 0,0", "1,,1"}) {
        EXPECT_FALSE(parse_background(bad)) << bad;
        EXPECT_EQ(complaint("background", bad), std::string("--background: '") + bad + "' is not " + kBackgroundValues);
    }
}

TEST(Options, BackgroundIsWrittenAsItIsRead) {
    for (const char* text : {"black", "white", "random", "0.1,0.25,1", "0,0,1e-05"})
        EXPECT_EQ(background_text(*parse_background(text)), text);
    EXPECT_EQ(background_text(*parse_background("0,0.0,0")), "black");
    EXPECT_EQ(background_text(*parse_background("1,1.00,1")), "white");
}

/// Every value of an enum has its word, which is read back, and messages of tests show it.
template <Choice T> void expect_words_for_all_values(T last) {
    ASSERT_EQ(words<T>().size(), std::size_t(last) + 1);
    for (int value = 0; value <= int(last); ++value) {
        EXPECT_EQ(choice_of<T>(word(T(value))), T(value));
        EXPECT_EQ(::testing::PrintToString(T(value)), word(T(value)));
    }
    EXPECT_FALSE(choice_of<T>("no such word"));
}

TEST(Choices, EveryValueHasItsWord) {
    expect_words_for_all_values(Strategy::kNone);
    expect_words_for_all_values(Device::kCuda);
    expect_words_for_all_values(PpispMode::kAuto);
    expect_words_for_all_values(MaskMode::kTransparent);
    expect_words_for_all_values(AlphaMode::kMask);
    expect_words_for_all_values(AppearanceStorage::kFp16);
    expect_words_for_all_values(AppearanceMoments::kBf16);
    expect_words_for_all_values(ColorActivation::kHardSigmoid);
}

TEST(Options, ByteSizesAreParsed) {
    EXPECT_EQ(complaint("image-cache", "512MiB"), "");
    for (const char* key : {"image-cache", "size-limit"}) {
        for (const char* bad : {"lots", "-5MB", "5XB"})
            EXPECT_NE(complaint(key, bad).find(std::string("--") + key + ": byte size '" + bad), std::string::npos)
                << bad;
    }
}

TEST(Options, ResumingTheLatestNeedsItsFolder) {
    TrainOptions options = with_source();
    options.resume = "latest";
    EXPECT_THROW(resolve(options), UsageError);
    options.model = "run";
    EXPECT_NO_THROW(resolve(options));
}

TEST(Options, ARecipeLeavesNamedOptionsAlone) {
    TrainOptions options = with_source();
    options.preset = Preset::kFast;
    options.opacity_reg = 0.02, options.named = {"opacity-reg"};
    options = resolve(options);
    EXPECT_EQ(options.iterations, 5000);
    EXPECT_EQ(options.recipe, Recipe::kFrontier);
    EXPECT_EQ(options.opacity_reg, 0.02);
    EXPECT_EQ(options.scale_reg, 0.003);
    EXPECT_EQ(kept_from_recipe(options), std::vector<std::string>{"opacity-reg 0.02"});
    TrainOptions paper = with_source();
    paper = resolve(paper);
    EXPECT_EQ(paper.recipe, Recipe::kPaper);
    EXPECT_EQ(paper.scale_reg, 0.01);
    EXPECT_TRUE(kept_from_recipe(paper).empty());
}

TEST(Options, RatesFallWhereGaussiansLoseTheirResiduals) {
    const auto final_rate = [](std::optional<double> share, std::optional<double> bytes, bool named) {
        TrainOptions options = with_source();
        options.appearance_share = share, options.appearance_bytes = bytes;
        if (named) options.named = {"final-rate"};
        options = resolve(options);
        return options.final_rate;
    };
    EXPECT_EQ(final_rate(1, {}, false), 1);
    EXPECT_EQ(final_rate(0, {}, false), 1) << "as none";
    EXPECT_EQ(final_rate(0.5, {}, false), 0.1);
    EXPECT_EQ(final_rate({}, {}, false), 0.1);
    EXPECT_EQ(final_rate(1, 50, false), 0.1);
    EXPECT_EQ(final_rate(0.5, {}, true), 1);
}

TEST(Options, ContradictionsWithATimeLimitAreRefused) {
    const auto refused = [](const std::function<void(TrainOptions&)>& change) {
        TrainOptions options = with_source();
        options.time_limit = parse_duration("5s", "");
        EXPECT_NO_THROW(resolve(options));
        change(options);
        EXPECT_THROW(resolve(options), UsageError);
    };
    refused([](TrainOptions& o) { o.preset = Preset::kBest; });
    refused([](TrainOptions& o) { o.schedule = ScheduleKind::kFixed; });
}

TEST(Options, ValidationResolvesWhatDependsOnTheStrategy) {
    TrainOptions mcmc = with_source(), adc = with_source();
    adc.strategy = Strategy::kAdc;
    mcmc = resolve(mcmc);
    adc = resolve(adc);
    EXPECT_EQ(mcmc.opacity_lr, 0.05);
    EXPECT_EQ(adc.opacity_lr, 0.025);
}

TEST(Options, AWordMayStandInPlaceOfANumber) {
    const Option& rate = find("opacity-lr");
    TrainOptions options = with_source();
    set_option(options, rate, {"auto"}, "--opacity-lr");
    options = resolve(options);
    EXPECT_FALSE(options.opacity_lr) << "not replaced by the strategy's number";
    EXPECT_EQ(option_text(rate, options), "auto");
    EXPECT_EQ(option_range(rate), "0..10 or auto");
    EXPECT_EQ(complaint("opacity-lr", "0.03"), "");
    EXPECT_EQ(complaint("opacity-lr", "11"), "option opacity-lr: 11 is out of range (0..10 or auto)");
    EXPECT_EQ(complaint("opacity-lr", "Auto"), "--opacity-lr: 'Auto' is not a finite number");
    EXPECT_EQ(complaint("opacity-lr", "nan"), "--opacity-lr: 'nan' is not a finite number");
    EXPECT_EQ(complaint("scaling-lr", "auto"), "--scaling-lr: 'auto' is not a finite number");
}

TEST(Options, EverySpellingOfTheNumberThatUnsetsDoesSo) {
    for (const auto& [key, texts] : {std::pair{"target-psnr", std::vector<std::string>{"0", "0.0", "0e3", "-0"}},
                                     {"appearance-bytes", {"0", "0.0"}},
                                     {"checkpoint-minutes", {"0", "0.0"}},
                                     {"preview-every", {"0", "00"}},
                                     {"batch", {"0", "00"}},
                                     {"resolution", {"-1", "-01"}}}) {
        for (const std::string& text : texts) {
            TrainOptions options = with_source();
            set_option(options, find(key), {text}, key);
            EXPECT_EQ(option_text(find(key), options), texts[0]) << key << " " << text;
            options = resolve(options);
            EXPECT_FALSE(options.target_psnr || options.appearance_bytes || options.preview_every || options.batch ||
                         options.resolution)
                << key << " " << text;
            EXPECT_EQ(options.checkpoint_minutes.has_value(), key != std::string("checkpoint-minutes")) << text;
        }
    }
}

TEST(Options, DocumentationPageIsTheGeneratedOne) {
    const auto& models = appearance_models();
    if (std::none_of(models.begin(), models.end(), [](const ModelInfo* m) { return m->variant; }))
        GTEST_SKIP() << "built without GSAPP_VARIANTS";
    std::ifstream file(std::filesystem::path(GSAPP_SOURCE_DIR) / "docs/options.md");
    ASSERT_TRUE(file) << "docs/options.md is missing";
    std::stringstream text;
    text << file.rdbuf();
    EXPECT_EQ(text.str(), options_markdown()) << "run: gsapp options --markdown > docs/options.md";
}

}  // namespace
}  // namespace gs
