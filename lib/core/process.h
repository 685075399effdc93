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

/// Starts `program` without waiting for it, and returns its process id. The first of `arguments` is the program's name.
/// The program gets no input, its stdout is discarded, and it shares stderr. `environment` is added to the current
/// environment. Throws Error if the program cannot be started.
pid_t start_process(const std::string& program, const std::vector<std::string>& arguments,
                    const std::vector<std::pair<std::string, std::string>>& environment);

/// Runs `arguments[0]` (looked up on PATH) without a shell and waits for it; `on_line` receives every line of its
/// output. `environment` is added to the current environment. With `stop` the program runs in its own process group, so
/// that Ctrl-C does not reach it. Instead `stop` is called ten times a second, and when it first returns true the
/// program gets one SIGINT. Throws UsageError if the program does not exist, Error if it cannot be started for another
/// reason.
ProcessResult run_process(const std::vector<std::string>& arguments,
                          const std::vector<std::pair<std::string, std::string>>& environment,
                          const std::function<void(const std::string&)>& on_line,
                          const std::function<bool()>& stop = {});

}  // namespace gs
