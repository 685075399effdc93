// SPDX-License-Identifier: Apache-2.0
// Runs another program and reads what it prints.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace gs {

struct ProcessResult {
    int exit_code = 0;                    ///< of the program; 128 + signal when a signal ended it
    std::vector<std::string> last_lines;  ///< of stdout and stderr together, at most 12, empty ones left out
};

/// Runs `arguments[0]` (looked up on PATH) without a shell and waits for it; `on_line` gets every line it prints.
/// `environment` is added to this program's. With `stop` the program is not in this one's process group, so that Ctrl-C does not reach
/// it; `stop` is asked ten times a second instead, and the first time that it is true the program gets one SIGINT. Throws UsageError
/// when the program does not exist, Error when it cannot be started for another reason.
ProcessResult run_process(const std::vector<std::string>& arguments, const std::vector<std::pair<std::string, std::string>>& environment,
                          const std::function<void(const std::string&)>& on_line, const std::function<bool()>& stop = {});

}  // namespace gs
