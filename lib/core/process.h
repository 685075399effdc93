// SPDX-License-Identifier: Apache-2.0
// Runs another program and reads its output.
#pragma once

#include <sys/types.h>

#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace gs {

struct ProcessResult {
    int exit_code = 0;                    ///< the program's exit code; 128 + signal if a signal ended it
    std::vector<std::string> last_lines;  ///< last non-empty lines of stdout and stderr together, at most 12
};

/// Starts `program` with `arguments`, of which the first is its name, and does not wait for it. It gets no input, its
/// stdout goes nowhere, and it shares stderr. `environment` is added to this program's. Returns its process id. Throws
/// Error when it cannot be started.
pid_t start_process(const std::string& program, const std::vector<std::string>& arguments,
                    const std::vector<std::pair<std::string, std::string>>& environment);

/// Runs `arguments[0]` (looked up on PATH) without a shell and waits for it; `on_line` gets every line it prints.
/// `environment` is added to this program's. With `stop` the program runs in its own process group, so that Ctrl-C does
/// not reach it. Instead `stop` is called ten times a second, and the program gets one SIGINT the first time that it
/// returns true. Throws UsageError when the program does not exist, Error when it cannot be started for another reason.
ProcessResult run_process(const std::vector<std::string>& arguments,
                          const std::vector<std::pair<std::string, std::string>>& environment,
                          const std::function<void(const std::string&)>& on_line,
                          const std::function<bool()>& stop = {});

}  // namespace gs
