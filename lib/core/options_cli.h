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

/// Rules by which a command that works on finished runs combines options.
struct ResolveRules {
    bool stored_run = false;     ///< also read config.yaml of the output folder when no run is resumed
    std::string default_source;  ///< scene used if none is named
};

/// Declares every option of the table on `app`, with its aliases and, hidden, its spelling with underscores and those
/// of other programs (foreign_options.h), plus `--config` and `--white-background`. Leaves out `without`, the key of an
/// option whose flag means something else in a subcommand. The object must live until `resolve` was called.
class TrainArguments {
  public:
    explicit TrainArguments(CLI::App& app, const std::string& without = "");
    /// Declares only the options of these `keys`, under the heading `group`, with the switches of other programs that
    /// set them. For `apply`.
    TrainArguments(CLI::App& app, const std::vector<std::string>& keys, const std::string& group);
    TrainArguments(const TrainArguments&) = delete;
    TrainArguments& operator=(const TrainArguments&) = delete;

    /// Returns the resolved options: defaults, overridden by the file of --config, overridden by the flags. A run that
    /// is resumed without --config uses the config.yaml of its output folder, so that only changes need flags. Call it
    /// after parsing. Warns of options of other programs that change nothing here. Throws UsageError, also for those
    /// that ask for what is missing here.
    TrainOptions resolve(const ResolveRules& rules = {}) const;

    /// Returns the same options unresolved, for callers that still change them.
    TrainOptions combine(const ResolveRules& rules = {}) const;

    /// Overrides `options` by the flags that were given and checks the value of each by itself. Throws UsageError.
    void apply(TrainOptions& options) const;

    /// Returns the keys of the options that flags set.
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
    /// An option of another program that is no synonym.
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
    std::set<std::string> names_;  ///< all that are declared
    std::string config_, foreign_command_;
};

}  // namespace gs
