// SPDX-License-Identifier: Apache-2.0
// Declares and reads the options of a training run as command-line flags.
#pragma once

#include <CLI/CLI.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "lib/core/foreign_options.h"
#include "lib/core/options.h"

namespace gs {

/// Rules for combining options in commands that work on finished runs.
struct ResolveRules {
    bool stored_run = false;     ///< also read config.yaml of the output folder if no run is resumed
    std::string default_source;  ///< scene to use if none is named
};

/// Declares every option of the table on `app`, plus `--config` and `--white-background`. Each option has its aliases
/// and, hidden, its spelling with underscores and the spellings of other programs (foreign_options.h). Omits the option
/// with key `without`, whose flag has another meaning in a subcommand. The object must live until `resolve` has
/// returned.
class TrainArguments {
  public:
    explicit TrainArguments(CLI::App& app, const std::string& without = "");
    /// Declares only the options of these `keys`, under the heading `group`, with the switches of other programs that
    /// set them. For use with `apply`.
    TrainArguments(CLI::App& app, const std::vector<std::string>& keys, const std::string& group);
    TrainArguments(const TrainArguments&) = delete;
    TrainArguments& operator=(const TrainArguments&) = delete;

    /// Returns the resolved options: defaults, overridden by the file of --config, overridden by the flags. A run that
    /// is resumed without --config uses the config.yaml of its output folder, so that only changes need flags. Call it
    /// after parsing. Warns of other programs' options that have no effect here. Throws UsageError, also for other
    /// programs' options that request a missing feature.
    TrainOptions resolve(const ResolveRules& rules = {}) const;

    /// Returns the same options unresolved, for callers that modify them further.
    TrainOptions combine(const ResolveRules& rules = {}) const;

    /// Overrides `options` by the given flags and checks each value on its own. Throws UsageError.
    void apply(TrainOptions& options) const;

    /// Returns the keys of the options that the flags set.
    std::set<std::string> given() const;

  private:
    TrainOptions base(bool stored_run) const;
    void apply_flags(TrainOptions& options) const;
    void check_foreign() const;
    /// Returns the command that kForeignCommandFlag names, or null.
    const ForeignCommand* foreign_command() const;
    struct Flag {
        const Option* option;
        CLI::Option* cli;
    };
    /// An option of another program that is not a synonym.
    struct ForeignFlag {
        const ForeignProgram* program;
        const ForeignOption* option;
        CLI::Option* cli;

        bool given() const;
    };
    void declare(CLI::App& app, const Option& option, const std::vector<std::string>& names, const std::string& group);
    void declare_foreign(CLI::App& app, const std::string& without);
    void declare_foreign(CLI::App& app, const ForeignProgram& program, const ForeignOption& option);
    std::string new_names(const std::vector<std::string>& names);
    CLI::Option* declare_spelling(CLI::App& app, const Option& option, const std::string& names);

    std::vector<Flag> flags_;
    std::vector<ForeignFlag> foreign_;
    std::set<std::string> names_;  ///< all declared names
    std::string config_, foreign_command_;
};

}  // namespace gs
