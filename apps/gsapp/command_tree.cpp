// SPDX-License-Identifier: Apache-2.0
// Walks over the commands that CLI11 knows.
#include "apps/gsapp/command_tree.h"

#include <algorithm>
#include <sstream>

#include "lib/core/options.h"

namespace gs {
namespace {

std::vector<std::string> split(const std::string& text, char separator) {
    std::vector<std::string> parts;
    std::istringstream in(text);
    for (std::string part; std::getline(in, part, separator);) parts.push_back(part);
    return parts;
}

/// Fills in what CLI11 says of a value in one text: "TEXT:{web,ply,splat}", "INT:INT in [0 - 1000]", "DIR".
void read_type(const std::string& type, OptionWords& words) {
    words.value = type.substr(0, type.find(':'));
    if (const auto brace = type.find('{'); brace != std::string::npos)
        words.choices = split(type.substr(brace + 1, type.find('}') - brace - 1), ',');
    const auto open = type.find(" in ["), dash = type.find(" - ");
    if (open != std::string::npos && dash != std::string::npos)
        words.range =
            type.substr(open + 5, dash - open - 5) + ".." + type.substr(dash + 3, type.find(']', dash) - dash - 3);
}

OptionWords option_words(const CLI::Option& option) {
    OptionWords words;
    for (const std::string& name : option.get_snames()) words.names.push_back("-" + name);
    for (const std::string& name : option.get_lnames()) words.names.push_back("--" + name);
    words.positional = option.get_name(true);
    words.help = option.get_description();
    words.preset = option.get_default_str();
    words.group = option.get_group();
    words.needs_value = option.get_items_expected_min() > 0;
    words.is_list = option.get_expected_max() > 1;
    words.is_required = option.get_required();
    if (option.get_items_expected_max() > 0) read_type(option.get_type_name(), words);
    words.is_basic = words.group == "Options";          // CLI11's own heading, of options that were given no other
    for (const Option& known : train_option_table()) {  // whose words CLI11 does not know
        if (std::find(words.names.begin(), words.names.end(), "--" + known.key) == words.names.end() ||
            !words.help.starts_with(known.help))
            continue;
        words.is_basic = known.is_basic;
        if (known.values.empty()) words.choices = known.choices;
    }
    return words;
}

CommandWords walk(const CLI::App& app, const std::string& name) {
    CommandWords words{.name = name, .description = app.get_description(), .options = {}, .commands = {}};
    for (const CLI::Option* option : app.get_options())
        if (!option->get_group().empty()) words.options.push_back(option_words(*option));
    for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
        if (!sub->get_group().empty())
            words.commands.push_back(walk(*sub, name + (name.empty() ? "" : " ") + sub->get_name()));
    return words;
}

void collect(const CommandWords& command, std::vector<const CommandWords*>& all) {
    for (const CommandWords& sub : command.commands) {
        all.push_back(&sub);
        collect(sub, all);
    }
}

}  // namespace

bool OptionWords::takes_file() const {
    static const std::vector<std::string> numbers = {"INT", "UINT", "FLOAT", "NUMBER", "INTEGER", "[PORT]"};
    return !value.empty() && choices.empty() && std::find(numbers.begin(), numbers.end(), value) == numbers.end();
}

CommandWords command_words(const CLI::App& app) { return walk(app, ""); }

std::vector<const CommandWords*> all_commands(const CommandWords& root) {
    std::vector<const CommandWords*> all;
    collect(root, all);
    return all;
}

std::string last_word(const std::string& name) { return name.substr(name.rfind(' ') + 1); }

std::string short_help(const std::string& help) {
    std::size_t end = help.size();
    for (const char* stop : {"; ", ". ", " ("}) end = std::min(end, help.find(stop));
    return help.substr(0, end);
}

}  // namespace gs
