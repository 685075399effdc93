// SPDX-License-Identifier: Apache-2.0
// Traverses the commands declared in CLI11, and prints the short help.
#include "apps/gsapp/command_tree.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
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

/// Parses CLI11's description of a value: "TEXT:{web,ply,splat}", "INT:INT in [0 - 1000]", "DIR".
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
    words.is_basic = words.group == "Options";          // CLI11's default heading
    for (const Option& known : train_option_table()) {  // values that CLI11 does not know
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

/// Width of a line, and the column at which descriptions begin.
constexpr std::size_t kColumns = 100, kDescription = 30;

/// Returns a short name, the shortest long name and the value: "-m, --model TEXT"; for a positional its name.
std::string spelling(const OptionWords& option) {
    std::string short_name, long_name;
    for (const std::string& name : option.names) {
        std::string& kept = name.starts_with("--") ? long_name : short_name;
        if (kept.empty() || name.size() < kept.size()) kept = name;
    }
    std::string text = short_name + (short_name.empty() || long_name.empty() ? "" : ", ") + long_name;
    if (text.empty()) return option.positional + (option.is_list ? "..." : "");
    constexpr std::size_t kMostChoices = 20;
    const std::string choices = fmt::format("{}", fmt::join(option.choices, "|"));
    const std::string value = choices.empty() || choices.size() > kMostChoices ? option.value : choices;
    return text + (value.empty() ? "" : " " + value) + (option.is_list ? " ..." : "");
}

/// Returns "  names   description", wrapped in the second column.
std::string entry(const std::string& names, const std::string& description) {
    std::string text, line = "  " + names;
    if (line.size() + 2 > kDescription) {
        text = line + "\n";
        line.clear();
    }
    line.resize(kDescription, ' ');
    std::size_t words = 0;
    for (std::size_t at = 0; at < description.size();) {
        const std::size_t end = std::min(description.find(' ', at), description.size());
        if (words > 0 && line.size() + 1 + end - at > kColumns) {
            text += line + "\n";
            line.assign(kDescription, ' ');
            words = 0;
        }
        line += (words++ > 0 ? " " : "") + description.substr(at, end - at);
        at = end + 1;
    }
    return text + line + "\n";
}

/// Returns the first part of a help text without parentheses.
std::string brief(std::string help) {
    for (std::size_t open; (open = help.find(" (")) != std::string::npos;)
        help.erase(open, std::min(help.find(')', open), help.size() - 1) + 1 - open);
    return short_help(help);
}

class ShortHelp final : public CLI::Formatter {
  public:
    std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
        if (mode != CLI::AppFormatMode::Normal) return CLI::Formatter::make_help(app, name, mode);
        const CommandWords command = command_words(*app);
        std::string text = make_description(app) + make_usage(app, name) + "\nOptions:\n";
        std::size_t left_out = 0;
        for (const OptionWords& option : command.options) {
            if (std::find(option.names.begin(), option.names.end(), "--help") != option.names.end() ||
                std::find(option.names.begin(), option.names.end(), "--help-all") != option.names.end())
                continue;
            if (!option.is_basic) {
                ++left_out;
                continue;
            }
            // For an option whose value may be omitted, the preset is the value used then, not the default.
            const bool says_default =
                option.needs_value && !option.preset.empty() && option.help.find("efault") == std::string::npos;
            text += entry(spelling(option), brief(option.help) + (says_default ? " [" + option.preset + "]" : ""));
        }
        text += make_subcommands(app, mode);
        if (!app->get_footer().empty()) text += "\n" + make_footer(app);
        text += left_out > 0 ? fmt::format("\n{} --help-all explains these and {} further options.\n", name, left_out)
                             : fmt::format("\n{} --help-all says more about each.\n", name);
        return text;
    }
};

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

void set_up_help(CLI::App& app) {
    app.set_help_flag("-h,--help", "Print this help and exit");
    app.set_help_all_flag("--help-all", "Print the help of all options and exit");
    app.formatter(std::make_shared<ShortHelp>());
}

}  // namespace gs
