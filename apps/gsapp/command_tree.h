// SPDX-License-Identifier: Apache-2.0
// The commands and options of the program as data, for its manual and for shells, and their help: what fits one screen
// with --help, everything with --help-all.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace gs {

/// One option or positional argument as a user may write it.
struct OptionWords {
    std::vector<std::string> names;    ///< with their hyphens, short ones first; empty for a positional
    std::string positional;            ///< its name there, empty if it has none
    std::string value;                 ///< what follows it ("DIR", "INTEGER"), empty for a switch
    std::vector<std::string> choices;  ///< the words that it takes, where these are all
    std::string range;                 ///< "1..1000", where help does not say it
    std::string help, preset;          ///< `preset` is the default, where one is shown
    std::string group;                 ///< heading
    bool needs_value = false, is_list = false, is_required = false;
    bool is_basic = true;  ///< stands in the help that fits one screen

    /// Returns whether the value may be the name of a file or folder.
    bool takes_file() const;
};

/// A command with its own commands. Hidden commands, options and spellings are left out.
struct CommandWords {
    std::string name;  ///< "bench frames"; empty for the program
    std::string description;
    std::vector<OptionWords> options;
    std::vector<CommandWords> commands;
};

CommandWords command_words(const CLI::App& app);

/// Returns all commands below `root`, a command before its own.
std::vector<const CommandWords*> all_commands(const CommandWords& root);

/// Returns the last word of a command's name.
std::string last_word(const std::string& name);

/// Returns what a help text says first, for lists with one line an option.
std::string short_help(const std::string& help);

/// Gives `app`, and the subcommands that are added to it later, the flag --help-all and the short --help. That has a
/// few words on each option of the command itself, if it stands under no heading of its own, and on the basic ones of a
/// training (Option::is_basic).
void set_up_help(CLI::App& app);

}  // namespace gs
