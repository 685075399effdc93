// SPDX-License-Identifier: Apache-2.0
// How commands print what they have measured.
#pragma once

#include <CLI/CLI.hpp>

#include "eval/pages/text_table.h"

namespace gs {

/// Returns the style of tables on stdout: plain on a terminal, Markdown elsewhere.
TableStyle stdout_style();

/// Adds --json, which asks for JSON instead of tables.
void add_json_flag(CLI::App& command, bool& json);

}  // namespace gs
