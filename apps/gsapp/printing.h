// SPDX-License-Identifier: Apache-2.0
// How commands print what they have measured, and what this build of the program is.
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "eval/pages/text_table.h"

namespace gs {

/// Returns the style of tables on stdout: plain on a terminal, Markdown elsewhere.
TableStyle stdout_style();

/// Adds --json, which asks for JSON instead of tables.
void add_json_flag(CLI::App& command, bool& json);

/// Adds --json to a command that prints nothing without it.
void add_outcome_flag(CLI::App& command, bool& json);

/// Prints a JSON object to stdout.
void print_json(const nlohmann::ordered_json& json);

/// Adds --quiet, which leaves out the messages below warnings.
CLI::Option* add_quiet_flag(CLI::App& command);

/// Returns version, backends, and what CUDA was built for and found, or why there is none.
std::string version_report();

/// Returns the same for programs, and the instruction sets that the build needs.
nlohmann::ordered_json version_json();

}  // namespace gs
