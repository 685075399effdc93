// SPDX-License-Identifier: Apache-2.0
// Options in YAML files: round trip, parents, and what errors say.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

using test::TemporaryFolder;

std::string complaint(const std::string& yaml) {
    TemporaryFolder folder;
    const auto file = folder.write("run.yaml", yaml);
    try {
        load_options_yaml(file);
    } catch (const UsageError& e) {
        std::string text = e.what();
        const std::size_t at = text.find(file.string());
        return at == std::string::npos ? text : text.replace(at, file.string().size(), "run.yaml");
    }
    return "";
}

/// A value that differs from the default, for every type and every table entry.
std::vector<std::string> other_value(const Option& option) {
    if (option.key == "image-cache" || option.key == "size-limit") return {"1MiB"};
    if (option.key == "time-limit" || option.key == "frame-limit") return {"5ms"};
    if (option.key == "background") return {"0.1,0.25,1"};
    if (!option.choices.empty())
        return {option.choices.back() == option_text(option, {}) ? option.choices.front() : option.choices.back()};
    if (std::holds_alternative<std::string TrainOptions::*>(option.field)) return {"a: \"b\" #c"};
    if (std::holds_alternative<bool TrainOptions::*>(option.field)) return {"true"};
    const double low = option.min.value_or(0), high = option.max.value_or(1);
    const std::string real = fmt::format("{}", low + 0.1234567890123456 * (std::min(high, low + 1) - low));
    if (const auto* of_model = std::get_if<ModelOptionField>(&option.field)) return {of_model->is_whole ? "2" : real};
    if (std::holds_alternative<std::uint64_t TrainOptions::*>(option.field)) return {"18446744073709551615"};
    if (std::holds_alternative<double TrainOptions::*>(option.field) ||
        std::holds_alternative<std::optional<double> TrainOptions::*>(option.field))
        return {real};
    if (std::holds_alternative<std::vector<std::int64_t> TrainOptions::*>(option.field)) return {"7", "30000"};
    return {"2"};
}

TEST(OptionsYaml, EveryOptionSurvivesTheRoundTrip) {
    TrainOptions options;
    for (const Option& option : train_option_table()) {
        set_option(options, option, other_value(option), option.key);
        EXPECT_NE(option_text(option, options), option_text(option, TrainOptions{})) << option.key;
    }
    TemporaryFolder folder;
    const TrainOptions read = load_options_yaml(folder.write("run.yaml", options_to_yaml(options)));
    for (const Option& option : train_option_table())
        EXPECT_EQ(option_text(option, read), option_text(option, options)) << option.key;
    EXPECT_EQ(options_to_yaml(read), options_to_yaml(options));
}

TEST(OptionsYaml, AWordInPlaceOfANumberSurvivesTheRoundTrip) {
    TemporaryFolder folder;
    const TrainOptions options = load_options_yaml(folder.write("run.yaml", "opacity-lr: auto\n"));
    const std::string text = options_to_yaml(options);
    EXPECT_NE(text.find("opacity-lr: auto\n"), std::string::npos);
    EXPECT_EQ(options_to_yaml(load_options_yaml(folder.write("again.yaml", text))), text);
}

TEST(OptionsYaml, DefaultsSurviveTheRoundTrip) {
    TemporaryFolder folder;
    const TrainOptions read = load_options_yaml(folder.write("run.yaml", options_to_yaml({})));
    EXPECT_EQ(options_to_yaml(read), options_to_yaml({}));
}

TEST(OptionsYaml, NamesThatAreNotUtf8SurviveTheRoundTrip) {
    for (const char* name :
         {"caf\xE9", "\xFF", "a \"b\" \\ \t #c: \xE9\n", "not-utf-8-source", "caf\xC3\xA9", "'\xE9'"}) {
        TrainOptions options;
        options.source = options.model = name;
        TemporaryFolder folder;
        const TrainOptions back = load_options_yaml(folder.write("run.yaml", options_to_yaml(options)));
        EXPECT_EQ(back.source, name);
        EXPECT_EQ(back.model, name);
    }
}

TEST(OptionsYaml, ChildBeatsParentAndParentIsRelativeToTheFile) {
    TemporaryFolder folder;
    std::filesystem::create_directory(folder.path() / "sub");
    folder.write("base.yaml", "cap-max: 5\nseed: 7\ntest-iterations: [1, 2]\n");
    const auto child = folder.write("sub/child.yaml", "cap-max: 6\nparent: ../base.yaml\n");
    const TrainOptions options = load_options_yaml(child);
    EXPECT_EQ(options.cap_max, 6);
    EXPECT_EQ(options.seed, 7u);
    EXPECT_EQ(options.test_iterations, (std::vector<std::int64_t>{1, 2}));
    EXPECT_EQ(options.iterations, TrainOptions{}.iterations);
}

TEST(OptionsYaml, LoopOfParentsIsAnError) {
    TemporaryFolder folder;
    folder.write("a.yaml", "parent: b.yaml\n");
    const auto b = folder.write("b.yaml", "parent: a.yaml\n");
    EXPECT_THROW(load_options_yaml(b), UsageError);
}

TEST(OptionsYaml, UnknownKeyNamesTheNearest) {
    EXPECT_EQ(complaint("seed: 1\ncap-mx: 3\n"),
              "run.yaml:2: unknown key 'cap-mx'; the nearest known key is 'cap-max'");
    EXPECT_NE(complaint("itertions: 3\n").find("'iterations'"), std::string::npos);
    EXPECT_NE(complaint("paren: x.yaml\n").find("'parent'"), std::string::npos);
}

TEST(OptionsYaml, WrongTypesNameFileLineKeyAndValue) {
    EXPECT_EQ(complaint("\ncap-max: many\n"), "run.yaml:2: cap-max: 'many' is not a whole number");
    EXPECT_EQ(complaint("cap-max: [1]\n"), "run.yaml:1: cap-max: the value is a list, but a single value is needed");
    EXPECT_EQ(complaint("eval: {a: 1}\n"), "run.yaml:1: eval: the value is a mapping, but a single value is needed");
    EXPECT_EQ(complaint("eval: 1\n"), "run.yaml:1: eval: '1' is not true or false");
    EXPECT_EQ(complaint("seed:\n"), "run.yaml:1: seed: the value is empty, but a single value is needed");
    EXPECT_EQ(complaint("test-iterations: [1, two]\n"), "run.yaml:1: test-iterations: 'two' is not a whole number");
    EXPECT_EQ(complaint("test-iterations: [[1]]\n"), "run.yaml:1: test-iterations: an element is a list, not a number");
}

TEST(OptionsYaml, ValuesOutOfRangeNameFileLineAndRange) {
    EXPECT_EQ(complaint("seed: 1\nsh-degree: 7\n"), "run.yaml:2: option sh-degree: 7 is out of range (0..3)");
    EXPECT_EQ(complaint("image-cache: 1 barrel\n").rfind("run.yaml:1: image-cache: byte size '1 barrel'", 0), 0u);
    EXPECT_EQ(complaint("resolution: 3\n").rfind("run.yaml:1: option resolution: 3 ", 0), 0u);
}

TEST(OptionsYaml, KeysStandOnce) {
    EXPECT_EQ(complaint("seed: 1\ncap-max: 5\nseed: 2\n"), "run.yaml:3: key 'seed' stands twice");
}

TEST(OptionsYaml, OneNumberIsAListOfOne) {
    TemporaryFolder folder;
    EXPECT_EQ(load_options_yaml(folder.write("run.yaml", "test-iterations: 5\n")).test_iterations,
              (std::vector<std::int64_t>{5}));
}

TEST(OptionsYaml, FilesThatAreNoOptionFilesAreErrors) {
    EXPECT_NE(complaint("- 1\n- 2\n").find("the file is a list"), std::string::npos);
    EXPECT_NE(complaint("a: [1\n").find("not valid YAML"), std::string::npos);
    EXPECT_THROW(load_options_yaml("/nowhere/at/all.yaml"), UsageError);
    TemporaryFolder folder;
    EXPECT_THROW(load_options_yaml(folder.path()), UsageError);
    EXPECT_NO_THROW(load_options_yaml(folder.write("empty.yaml", "")));
}

// yaml-cpp takes the first line alone and leaves the others unread.
TEST(OptionsYaml, LinesBehindTheEndOfTheDocumentAreAnError) {
    EXPECT_EQ(complaint("  seed: 1\ncap-max: 5\n").rfind("run.yaml:2: not valid YAML: the document ends", 0), 0u);
    EXPECT_EQ(complaint("{seed: 1}\ncap-max: 5\n").rfind("run.yaml:2: not valid YAML: the document ends", 0), 0u);
    TemporaryFolder folder;
    EXPECT_EQ(load_options_yaml(folder.write("run.yaml", "---\nseed: 7\n---\n# end\n")).seed, 7u);
}

TEST(OptionsYaml, RunFolderIsReadThroughItsConfig) {
    TemporaryFolder folder;
    EXPECT_THROW(load_run_options(folder.path()), DataError);
    TrainOptions options;
    options.source = "builtin:diffuse";
    folder.write("config.yaml", "# gsapp 0.1.0\n" + options_to_yaml(options));
    EXPECT_EQ(load_run_options(folder.path()).source, "builtin:diffuse");
}

}  // namespace
}  // namespace gs
