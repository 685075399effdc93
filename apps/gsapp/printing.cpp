// SPDX-License-Identifier: Apache-2.0
// Looks at stdout to choose how tables are printed, and adds the options that commands share.
#include "apps/gsapp/printing.h"

#include <unistd.h>

#include <cstdio>

#include "lib/core/json_text.h"
#include "lib/core/log.h"

namespace gs {

TableStyle stdout_style() { return ::isatty(STDOUT_FILENO) != 0 ? TableStyle::kTerminal : TableStyle::kMarkdown; }

void add_json_flag(CLI::App& command, bool& json) {
    command.add_flag("--json", json, "Print all figures as JSON instead of tables");
}

void add_outcome_flag(CLI::App& command, bool& json) {
    command.add_flag("--json", json, "Print what was written, and its figures, as JSON");
}

void print_json(const nlohmann::ordered_json& json) { std::fputs((json_text(json, 1) + "\n").c_str(), stdout); }

CLI::Option* add_quiet_flag(CLI::App& command) {
    return command.add_flag_callback(
        "-q,--quiet", [] { setup_log(LogLevel::kWarn); }, "No messages below warnings");
}

}  // namespace gs
