// SPDX-License-Identifier: Apache-2.0
// Options of other programs: the table, the command line that understands it, and the page about it.
#include "lib/core/foreign_options.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>

#include "kernels/core/error.h"
#include "lib/core/options_cli.h"

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
    EXPECT_NO_THROW(parse({"--source", "here", "--antialiasing=false"}));
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
