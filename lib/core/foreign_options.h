// SPDX-License-Identifier: Apache-2.0
// The options of other programs: the counterpart of each in gsapp, or the reason why it has none. The command line,
// docs/coming-from.md and the tests iterate over this table.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace gs {

/// The treatment of an option of another program.
enum class ForeignUse {
    kSynonym,  ///< another spelling of the option `key`
    kSets,     ///< a switch that sets the option `key` to `value`
    kIgnored,  ///< has no effect here and causes a warning; `note` is the reason
    kMissing,  ///< requests a feature that gsapp lacks, which is an error; `note` explains
};

/// One option of another program.
struct ForeignOption {
    std::string name;  ///< name as that program spells it
    ForeignUse use = ForeignUse::kSynonym;
    std::string key = {};         ///< kSynonym, kSets: key of the option of gsapp
    std::string value = {};       ///< kSets: value of `key`; kIgnored, kMissing: value without effect
    std::string note = {};        ///< explanation for the user; empty = none
    std::string short_name = {};  ///< short spelling, such as "-d"
    bool is_switch = false;       ///< kIgnored, kMissing: whether it takes no value
};

struct ForeignProgram {
    std::string name, command;
    std::vector<ForeignOption> options;
};

/// A command word that other programs take before their options, and the options of gsapp that it stands for.
/// Explicitly given options override these.
struct ForeignCommand {
    std::string word, program;
    std::vector<std::pair<std::string, std::string>> settings;  ///< keys and values
    std::string missing = {};  ///< the missing feature, which is an error, and the nearest substitute; empty = none
};
const std::vector<ForeignCommand>& foreign_commands();

/// The hidden option of `gsapp train` that names a ForeignCommand.
inline constexpr const char* kForeignCommandFlag = "--as-in";

/// Inserts kForeignCommandFlag before a ForeignCommand that follows `train` and is not the name of a file or folder,
/// and removes the word with which ns-train names the kind of the scene.
std::vector<std::string> with_foreign_command(std::vector<std::string> words);

/// Returns all programs. If several have the same option, that of the first program applies on the command line.
const std::vector<ForeignProgram>& foreign_programs();

/// Returns the spellings of `option`: the original, with hyphens, with underscores, and the short one.
std::vector<std::string> spellings(const ForeignOption& option);

/// Returns the text of docs/coming-from.md.
std::string coming_from_markdown();

}  // namespace gs
