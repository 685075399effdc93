// SPDX-License-Identifier: Apache-2.0
// Looks at stdout to choose how tables are printed.
#include "apps/gsapp/printing.h"

#include <unistd.h>

namespace gs {

TableStyle stdout_style() { return ::isatty(STDOUT_FILENO) != 0 ? TableStyle::kTerminal : TableStyle::kMarkdown; }

void add_json_flag(CLI::App& command, bool& json) {
    command.add_flag("--json", json, "Print all figures as JSON instead of tables");
}

}  // namespace gs
