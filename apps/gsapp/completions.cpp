// SPDX-License-Identifier: Apache-2.0
// `gsapp completions`: the completion scripts for bash, zsh and fish. Called by the build.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>

#include "apps/gsapp/command.h"
#include "apps/gsapp/command_tree.h"

namespace gs {
namespace {

/// Returns `text` in single quotes, valid in any shell.
std::string quoted(const std::string& text) {
    std::string out = "'";
    for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return out + "'";
}

std::string joined(const std::vector<std::string>& words, const char* separator = " ") {
    return fmt::format("{}", fmt::join(words, separator));
}

std::string function_name(const CommandWords& command) {
    std::string name = "_gsapp_" + command.name;
    for (char& c : name)
        if (c == ' ' || c == '-') c = '_';
    return name;
}

// bash

/// Returns the patterns "command:option" of the options of `command` for which `wanted` holds.
template <class Wanted> std::vector<std::string> patterns(const CommandWords& command, const Wanted& wanted) {
    std::vector<std::string> out;
    for (const OptionWords& option : command.options)
        if (wanted(option))
            for (const std::string& name : option.names) out.push_back(quoted(command.name + ":" + name));
    return out;
}

/// Returns the completions if `command` is the innermost command: its subcommands and the choices of its positional
/// arguments, and its options after a hyphen.
std::string bash_words(const CommandWords& command) {
    std::vector<std::string> options, words;
    for (const OptionWords& option : command.options) {
        options.insert(options.end(), option.names.begin(), option.names.end());
        if (option.names.empty()) words.insert(words.end(), option.choices.begin(), option.choices.end());
    }
    for (const CommandWords& sub : command.commands) words.push_back(last_word(sub.name));
    return fmt::format("        {}) options={} words={} ;;\n", quoted(command.name), quoted(joined(options)),
                       quoted(joined(words)));
}

std::string bash_completions(const CommandWords& root) {
    std::vector<const CommandWords*> commands = all_commands(root);
    std::vector<std::string> names, files, numbers;
    for (const CommandWords* command : commands) names.push_back(quoted(command->name));
    commands.insert(commands.begin(), &root);
    std::string words, choices;
    for (const CommandWords* command : commands) {
        words += bash_words(*command);
        for (const OptionWords& option : command->options) {
            if (option.choices.empty() || option.names.empty()) continue;
            CommandWords alone{.name = command->name, .description = {}, .options = {option}, .commands = {}};
            choices += fmt::format("        {}) words={} ;;\n",
                                   joined(patterns(alone, [](const OptionWords&) { return true; }), "|"),
                                   quoted(joined(option.choices)));
        }
        for (const std::string& one :
             patterns(*command, [](const OptionWords& o) { return o.needs_value && o.takes_file(); }))
            files.push_back(one);
        for (const std::string& one : patterns(
                 *command, [](const OptionWords& o) { return o.needs_value && !o.takes_file() && o.choices.empty(); }))
            numbers.push_back(one);
    }
    return fmt::format(
        R"bash(# bash completion of gsapp, written by: gsapp completions bash
_gsapp() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD - 1]}} command= options= words= kind=option i
    # bash takes --option=value apart at the equals sign.
    if [[ $current == = ]]; then
        current=
    elif [[ $previous == = ]]; then
        previous=${{COMP_WORDS[COMP_CWORD - 2]}}
    fi
    for ((i = 1; i < COMP_CWORD; i++)); do
        case "${{command:+$command }}${{COMP_WORDS[i]}}" in
        {names}) command="${{command:+$command }}${{COMP_WORDS[i]}}" ;;
        esac
    done
    case "$command:$previous" in
{choices}        {files}) kind=file ;;
        {numbers}) return ;;
        *) kind=word ;;
    esac
    if [[ $kind == word ]]; then
        case "$command" in
{words}        esac
        if [[ $current == -* ]]; then
            words=$options
        elif [[ -n $command ]]; then
            kind=file
        fi
    fi
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
    if [[ $kind == file ]]; then
        compopt -o filenames 2>/dev/null
        mapfile -t -O "${{#COMPREPLY[@]}}" COMPREPLY < <(compgen -f -- "$current")
    fi
}}
complete -F _gsapp gsapp
)bash",
        fmt::arg("names", joined(names, "|")), fmt::arg("choices", choices), fmt::arg("files", joined(files, "|")),
        fmt::arg("numbers", joined(numbers, "|")), fmt::arg("words", words));
}

// zsh

/// Returns `text` with an escape before each character that would end a part of an _arguments specification.
std::string zsh_text(const std::string& text) {
    std::string out;
    for (const char c : text) {
        if (c == '[' || c == ']' || c == ':' || c == '\\') out += '\\';
        out += c;
    }
    return out;
}

std::string zsh_action(const OptionWords& option) {
    if (!option.choices.empty()) return "(" + joined(option.choices) + ")";
    return option.takes_file() ? "_files" : " ";
}

std::string zsh_option(const OptionWords& option, int& position) {
    const std::string value =
        option.value.empty()
            ? ""
            : fmt::format("{}{}:{}", option.needs_value ? ":" : "::", zsh_text(option.value), zsh_action(option));
    std::string text;
    for (const std::string& name : option.names) {
        const std::string others = option.is_list ? "*" : "(" + joined(option.names) + ")";
        text += " \\\n        " + quoted(others + name + "[" + zsh_text(short_help(option.help)) + "]" + value);
    }
    if (!option.positional.empty())
        text += " \\\n        " +
                quoted((option.is_list ? "*" : std::to_string(++position)) + ":" + option.positional + ":_files");
    return text;
}

std::string zsh_arguments(const CommandWords& command) {
    int position = 0;
    std::string text;
    bool takes_rest = false;
    for (const OptionWords& option : command.options) {
        const bool is_rest = option.is_list && !option.positional.empty();
        if (is_rest && takes_rest) continue;
        text += zsh_option(option, position);
        takes_rest = takes_rest || is_rest;
    }
    return text;
}

std::string zsh_commands(const CommandWords& command) {
    std::string text;
    for (const CommandWords& sub : command.commands)
        text += " " + quoted(last_word(sub.name) + ":" + zsh_text(short_help(sub.description)));
    return text;
}

/// Returns the function that completes the arguments of `command`, whose name is the first of `words`.
std::string zsh_function(const CommandWords& command) {
    std::string text = fmt::format("{}() {{\n", function_name(command));
    if (!command.commands.empty()) {
        text += "    if (( CURRENT > 2 )); then\n        case $words[2] in\n";
        for (const CommandWords& sub : command.commands)
            text += fmt::format("        {}) shift words; (( CURRENT-- )); {}; return ;;\n", last_word(sub.name),
                                function_name(sub));
        text += fmt::format(
            "        esac\n    elif [[ $words[2] != -* ]]; then\n        local -a commands=({})\n"
            "        _describe command commands\n    fi\n",
            zsh_commands(command));
    }
    return text + "    _arguments -S" + zsh_arguments(command) + "\n}\n";
}

std::string zsh_completions(const CommandWords& root) {
    std::string text = "#compdef gsapp\n# zsh completion of gsapp, written by: gsapp completions zsh\n";
    for (const CommandWords* command : all_commands(root)) text += zsh_function(*command);
    return text + zsh_function(root) + "_gsapp_ \"$@\"\n";
}

// fish

std::string fish_condition(const CommandWords& command) {
    if (command.name.empty()) return "__fish_use_subcommand";
    std::string text;
    std::string rest = command.name + " ";
    for (std::size_t space; (space = rest.find(' ')) != std::string::npos; rest = rest.substr(space + 1))
        text += (text.empty() ? "" : "; and ") + std::string("__fish_seen_subcommand_from ") + rest.substr(0, space);
    if (command.commands.empty()) return text;
    text += "; and not __fish_seen_subcommand_from";
    for (const CommandWords& sub : command.commands) text += " " + last_word(sub.name);
    return text;
}

/// Returns `text` in quotes for fish, which escapes a quote with a backslash.
std::string fish_quoted(const std::string& text) {
    std::string out = "'";
    for (const char c : text) out += c == '\'' || c == '\\' ? std::string("\\") + c : std::string(1, c);
    return out + "'";
}

std::string fish_option(const OptionWords& option, const std::string& condition) {
    std::string text = "complete -c gsapp -n " + fish_quoted(condition);
    for (const std::string& name : option.names)
        text += (name[1] == '-' ? " -l " : " -s ") + name.substr(name[1] == '-' ? 2 : 1);
    if (!option.choices.empty())
        text += " -x -a " + fish_quoted(joined(option.choices));
    else if (option.needs_value)
        text += option.takes_file() ? " -r -F" : " -x";
    return text + " -d " + fish_quoted(short_help(option.help)) + "\n";
}

std::string fish_completions(const CommandWords& root) {
    std::vector<const CommandWords*> commands = all_commands(root);
    commands.insert(commands.begin(), &root);
    std::string text =
        "# fish completion of gsapp, written by: gsapp completions fish\n"
        "complete -c gsapp -n '__fish_use_subcommand' -f\n";
    for (const CommandWords* command : commands) {
        const std::string condition = fish_condition(*command);
        for (const CommandWords& sub : command->commands)
            text += fmt::format("complete -c gsapp -n {} -a {} -d {}\n", fish_quoted(condition), last_word(sub.name),
                                fish_quoted(short_help(sub.description)));
        for (const OptionWords& option : command->options)
            if (!option.names.empty()) text += fish_option(option, condition);
    }
    return text;
}

}  // namespace

void add_completions_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand("completions", "Print what lets a shell complete gsapp's command line");
    const auto shell = std::make_shared<std::string>();
    command->add_option("shell", *shell)->required()->check(CLI::IsMember({"bash", "zsh", "fish"}));
    command->group("");  // installed with the program; users need not call it
    command->callback([=, &app, &selected] {
        selected = [=, &app] {
            const CommandWords words = command_words(app);
            const std::string text = *shell == "bash"  ? bash_completions(words)
                                     : *shell == "zsh" ? zsh_completions(words)
                                                       : fish_completions(words);
            std::fputs(text.c_str(), stdout);
        };
    });
}

}  // namespace gs
