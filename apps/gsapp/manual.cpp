// SPDX-License-Identifier: Apache-2.0
// `gsapp manual`: writes the manual page gsapp(1). Called by the build.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

#include "apps/gsapp/command.h"
#include "apps/gsapp/command_tree.h"
#include "lib/core/version.h"

namespace gs {
namespace {

/// Returns `text` as one literal line of roff, with hyphens that can be copied.
std::string roff(const std::string& text) {
    std::string out;
    for (const char c : text) {
        if (c == '\\')
            out += "\\e";
        else if (c == '-')
            out += "\\-";
        else if (c == '\n')
            out += ' ';
        else
            out += c;
    }
    return !out.empty() && (out[0] == '.' || out[0] == '\'') ? "\\&" + out : out;
}

std::string bold(const std::string& text) { return "\\fB" + roff(text) + "\\fR"; }

std::string value_text(const OptionWords& option) {
    if (option.value.empty()) return "";
    return "\\fI" + roff(option.value) + "\\fR" + (option.is_list ? " ..." : "");
}

/// Returns help, range and default. The help of training options already contains the range.
std::string help_text(const OptionWords& option) {
    std::string text = option.help.empty() ? "No description" : option.help, range = option.range;
    if (!option.choices.empty()) range = fmt::format("{}", fmt::join(option.choices, ", "));
    if (!range.empty() && text.find("(" + range + ")") == std::string::npos) text += " (" + range + ")";
    if (!option.preset.empty() && text.find("default") == std::string::npos) text += "; default: " + option.preset;
    return roff(text);
}

std::string option_entry(const OptionWords& option) {
    std::string names;
    for (const std::string& name : option.names) names += (names.empty() ? "" : ", ") + bold(name);
    if (names.empty()) names = "\\fI" + roff(option.positional) + "\\fR";
    const std::string value = option.names.empty() ? "" : value_text(option);
    return ".TP\n" + names + (value.empty() ? "" : " " + value) + "\n" + help_text(option) + "\n";
}

std::string synopsis(const CommandWords& command) {
    std::string text = bold("gsapp " + command.name) + " [\\fIOPTIONS\\fR]";
    for (const OptionWords& option : command.options) {
        if (option.positional.empty()) {
            if (option.is_required) text += " " + bold(option.names.front()) + " " + value_text(option);
            continue;
        }
        const std::string name = "\\fI" + roff(option.positional) + "\\fR" + (option.is_list ? " ..." : "");
        text += option.is_required ? " " + name : " [" + name + "]";
    }
    return text;
}

/// Returns the section of a command. Training options, which other commands also accept, are listed only once.
std::string command_section(const CommandWords& command, const CommandWords& train) {
    const auto is_of_training = [&](const OptionWords& option) {
        return std::any_of(train.options.begin(), train.options.end(), [&](const OptionWords& other) {
            return !option.names.empty() && other.names == option.names && other.help == option.help;
        });
    };
    std::string text =
        ".SS " + roff(command.name) + "\n" + synopsis(command) + "\n.PP\n" + roff(command.description) + ".\n";
    std::string group;
    bool shares = false;
    for (const OptionWords& option : command.options) {
        const auto has_name = [&](const char* name) {
            return std::count(option.names.begin(), option.names.end(), name) > 0;
        };
        if (has_name("--help") || has_name("--help-all")) continue;
        if (&command != &train && option.names.size() > 0 && is_of_training(option)) {
            shares = true;
            continue;
        }
        if (&command == &train && option.group != group && option.group != "Options" && option.group != "Positionals")
            text += ".PP\n" + bold((group = option.group) + ":") + "\n";
        text += option_entry(option);
    }
    if (shares) text += ".PP\nOptions of " + bold("gsapp train") + " are taken as well, as far as they apply.\n";
    return text;
}

std::string manual(const CommandWords& root) {
    const auto commands = all_commands(root);
    const auto train = std::find_if(commands.begin(), commands.end(),
                                    [](const CommandWords* command) { return command->name == "train"; });
    std::string text = fmt::format(
        ".\\\" Written by: gsapp manual\n.TH GSAPP 1 \"\" \"gsapp {}\" \"User Commands\"\n.ad l\n.nh\n.SH NAME\ngsapp "
        "\\- trains, "
        "evaluates and shows 3D Gaussian splatting scenes\n.SH SYNOPSIS\n{} \\fICOMMAND\\fR [\\fIOPTIONS\\fR]\n.SH "
        "DESCRIPTION\n{}\nA scene is a COLMAP folder, a NeRF-synthetic folder, or a built-in one such as "
        "builtin:glossy. Results go to stdout, messages to stderr.\n",
        version(), bold("gsapp"), roff(root.description));
    for (const OptionWords& option : root.options) text += option_entry(option);
    text += ".SH COMMANDS\n";
    for (const CommandWords* command : commands) text += command_section(*command, **train);
    text +=
        R"(.SH EXIT STATUS
.TP
.B 0
done
.TP
.B 1
a fault of the program itself
.TP
.B 2
wrong command line or configuration
.TP
.B 3
input that is missing or damaged, or output that cannot be written
.TP
.B 4
device not available, or out of memory
.TP
.B 5
training ended in values that are not finite
.TP
.B 130
interrupted; a checkpoint was written before
.SH ENVIRONMENT
.TP
.B GSAPP_METRIC_WEIGHTS
folder of weights for learned metrics, if \-\-metric\-weights does not name one
.SH FILES
The folder
.I share/gsapp
beside the program's
.I bin
holds the web viewer, configurations of benchmark scenes and the scripts that fetch data;
.I share/doc/gsapp
holds the guide.
.SH EXAMPLES
.EX
gsapp train \-s builtin:glossy \-m output/glossy \-\-eval \-\-time\-limit 1m
gsapp eval output/glossy
gsapp export output/glossy \-o site
gsapp view site
.EE
)";
    return text;
}

}  // namespace

void add_manual_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand("manual", "Print the manual page gsapp(1)");
    command->group("");  // installed with the program; users need not call it
    command->callback(
        [&app, &selected] { selected = [&app] { std::fputs(manual(command_words(app)).c_str(), stdout); }; });
}

}  // namespace gs
