// SPDX-License-Identifier: Apache-2.0
// Prints the short help from the words of a command.
#include "apps/gsapp/help.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "apps/gsapp/command_tree.h"

namespace gs {
namespace {

/// The columns of a line, and where descriptions begin.
constexpr std::size_t kColumns = 100, kDescription = 30;

/// Returns a short name, the shortest long one and the value: "-m, --model TEXT"; for a positional its name.
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

/// Returns "  names   description", wrapped behind the names.
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

/// Returns what the help text says first, without what stands in parentheses.
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
            // The preset of an option that may stand alone is its value then, not its default.
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

void set_up_help(CLI::App& app) {
    app.set_help_flag("-h,--help", "Print this help and exit");
    app.set_help_all_flag("--help-all", "Print the help of all options and exit");
    app.formatter(std::make_shared<ShortHelp>());
}

}  // namespace gs
