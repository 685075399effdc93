// SPDX-License-Identifier: Apache-2.0
// The commands and options of the program as data, for its manual and for shell completions, and their help: a short
// form that fits one screen with --help, the full form with --help-all.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace gs {

/// One option or positional argument as typed by the user.
struct OptionWords {
    std::vector<std::string> names;    ///< with their hyphens, short names first; empty if only positional
    std::string positional;            ///< name as a positional argument; empty if it has none
    std::string value;                 ///< placeholder of the value ("DIR", "INTEGER"); empty for a flag
    std::vector<std::string> choices;  ///< the allowed words, if the list is complete
    std::string range;                 ///< "1..1000", if the help does not state it
    std::string help, preset;          ///< `preset` is the default, if one is shown
    std::string group;                 ///< heading in the help
    bool needs_value = false, is_list = false, is_required = false;
    bool is_basic = true;  ///< whether the short help shows it

    /// Returns whether the value may be a file or folder name.
    bool takes_file() const;
};

/// A command with its subcommands. Hidden commands, options and spellings are omitted.
struct CommandWords {
    std::string name;  ///< "bench frames"; empty for the program
    std::string description;
    std::vector<OptionWords> options;
    std::vector<CommandWords> commands;
};

CommandWords command_words(const CLI::App& app);

/// Returns all commands below `root`, each before its own subcommands.
std::vector<const CommandWords*> all_commands(const CommandWords& root);

/// Returns the last word of a command's name.
std::string last_word(const std::string& name);

/// Returns the first part of a help text, for lists with one line per option.
std::string short_help(const std::string& help);

/// Adds the flag --help-all and the short --help to `app`, and to the subcommands added to it later. The short help has
/// a few words on each of the command's own options that are under no separate heading, and on the basic options of a
/// training (Option::is_basic).
void set_up_help(CLI::App& app);

}  // namespace gs
