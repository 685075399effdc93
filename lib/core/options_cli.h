// SPDX-License-Identifier: Apache-2.0
// The options of a training run as command-line flags.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <utility>
#include <vector>

#include "lib/core/options.h"

namespace gs {

/// What a command that works on finished runs changes in the way options are put together.
struct ResolveRules {
    bool stored_run = false;     ///< config.yaml of the output folder is read not only when a run is resumed
    std::string default_source;  ///< taken where no scene is named
};

/// Declares every option of the table on `app`, with its aliases and hidden spellings, plus `--config` and
/// `--white-background`. The object must live until `resolve` was called.
class TrainArguments {
  public:
    explicit TrainArguments(CLI::App& app);
    TrainArguments(const TrainArguments&) = delete;
    TrainArguments& operator=(const TrainArguments&) = delete;

    /// Defaults, overlaid with the file of --config, overlaid with the flags; validated. A run that is resumed without
    /// --config takes the config.yaml of its output folder as the file, so that only changes need flags.
    /// Call after parsing. Throws UsageError.
    TrainOptions resolve(const ResolveRules& rules = {}) const;

    /// The same, not validated: for callers that change options before they do.
    TrainOptions combine(const ResolveRules& rules = {}) const;

  private:
    TrainOptions base(bool stored_run) const;
    void apply_flags(TrainOptions& options) const;
    struct Flag {
        const Option* option;
        CLI::Option* cli;
    };
    void declare(CLI::App& app, const Option& option);
    CLI::Option* declare_spelling(CLI::App& app, const Option& option, const std::string& names);

    std::vector<Flag> flags_;
    std::vector<CLI::Option*> white_;  ///< both spellings of --white-background
    std::string config_;
};

}  // namespace gs
