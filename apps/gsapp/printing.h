// SPDX-License-Identifier: Apache-2.0
// Prints measurements of commands, and the properties of this build of the program.
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "eval/pages/text_table.h"

namespace gs {

/// Returns the style of tables on stdout: plain on a terminal, Markdown elsewhere.
TableStyle stdout_style();

/// Adds --json, which requests JSON instead of tables.
void add_json_flag(CLI::App& command, bool& json);

/// Adds --json to a command that prints nothing without it.
void add_outcome_flag(CLI::App& command, bool& json);

/// Prints a JSON object to stdout.
void print_json(const nlohmann::ordered_json& json);

/// Adds --quiet, which suppresses messages below warnings.
CLI::Option* add_quiet_flag(CLI::App& command);

/// Returns version, backends, and the CUDA architectures and device, or the reason why CUDA is unavailable.
std::string version_report();

/// Returns the version report as JSON, with the instruction sets that the build requires.
nlohmann::ordered_json version_json();

}  // namespace gs
