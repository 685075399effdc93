// SPDX-License-Identifier: Apache-2.0
// The help of a command: what fits one screen with --help, everything with --help-all.
#pragma once

#include <CLI/CLI.hpp>

namespace gs {

/// Gives `app`, and the subcommands that are added to it later, the flag --help-all and the short --help. That has a
/// few words on each option of the command itself, if it stands under no heading of its own, and on the basic ones of a
/// training (Option::is_basic).
void set_up_help(CLI::App& app);

}  // namespace gs
