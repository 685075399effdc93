// SPDX-License-Identifier: Apache-2.0
// Runs a program, writes its lines down and turns its failure into an error.
#include "lib/scene/program_log.h"

#include <fmt/format.h>

#include <cerrno>
#include <utility>

#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/core/process.h"
#include "lib/io/temporary.h"

namespace gs {

ProgramLog::ProgramLog(std::filesystem::path file) : path_(std::move(file)), file_(path_) {
    if (!file_) fail_to_write("write", path_, errno);
}

void ProgramLog::run(const std::string& name, const std::vector<std::string>& arguments,
                     const std::function<void(const std::string&)>& on_line) {
    file_ << fmt::format("$ {}\n", fmt::join(arguments, " ")) << std::flush;
    ProcessResult result;
    try {
        // Debian's colmap is linked with Qt and needs a display even for work without windows.
        result = run_process(arguments, {{"QT_QPA_PLATFORM", "offscreen"}}, [&](const std::string& line) {
            file_ << line << '\n' << std::flush;
            on_line(line);
        });
    } catch (const UsageError& e) {
        throw UsageError(fmt::format("{}; install it with: apt-get install {}", e.what(), arguments[0]));
    }
    has_runs_ = true;
    if (interrupted()) throw Interrupted(fmt::format("stopped during {}", name));
    if (result.exit_code != 0)
        throw DataError(fmt::format("{} ended with exit code {}; its last lines:\n  {}", name, result.exit_code,
                                    fmt::join(result.last_lines, "\n  ")));
}

}  // namespace gs
