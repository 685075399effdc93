// SPDX-License-Identifier: Apache-2.0
// The options of other programs: what each is called here, or why it has no counterpart. The command line,
// docs/coming-from.md and the tests walk over this table.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace gs {

/// What gsapp makes of an option of another program.
enum class ForeignUse {
    kSynonym,  ///< another spelling of the option `key`
    kSets,     ///< a switch that gives the option `key` the value `value`
    kIgnored,  ///< changes nothing here, which is said; `note` has the reason
    kMissing,  ///< asks for what gsapp lacks, which is an error; `note` says what
};

/// One option of another program.
struct ForeignOption {
    std::string name;  ///< as that program spells it
    ForeignUse use = ForeignUse::kSynonym;
    std::string key = {};         ///< kSynonym, kSets: the option of gsapp
    std::string value = {};       ///< kSets: see there; kIgnored, kMissing: the value that asks for nothing
    std::string note = {};        ///< an empty note: nothing to know
    std::string short_name = {};  ///< "-d"
    bool is_switch = false;       ///< kIgnored, kMissing: takes no value
};

struct ForeignProgram {
    std::string name, command;
    std::vector<ForeignOption> options;
};

/// A word that other programs have in front of their options, and the options of gsapp that it stands for. Options
/// that are given beat them.
struct ForeignCommand {
    std::string word, program;
    std::vector<std::pair<std::string, std::string>> settings;  ///< keys and values
    std::string missing = {};  ///< what gsapp lacks for it, which is an error, and what comes near; empty: nothing
};
const std::vector<ForeignCommand>& foreign_commands();

/// The hidden option of `gsapp train` that names a ForeignCommand.
inline constexpr const char* kForeignCommandFlag = "--as-in";

/// Puts kForeignCommandFlag in front of a ForeignCommand that follows `train` and names no file or folder, and takes
/// out the word by which ns-train says of which kind a scene is.
std::vector<std::string> with_foreign_command(std::vector<std::string> words);

/// All programs. Where two have the same option, that of the first counts on the command line.
const std::vector<ForeignProgram>& foreign_programs();

/// Returns the spellings of `option`: its own, with hyphens, with underscores, and the short one.
std::vector<std::string> spellings(const ForeignOption& option);

/// Returns the text of docs/coming-from.md.
std::string coming_from_markdown();

}  // namespace gs
