// SPDX-License-Identifier: Apache-2.0
// Where messages go: stderr, and the log file of the run folder. stdout belongs to results and progress lines.
#pragma once

#include <filesystem>

#include "lib/core/choices.h"

namespace gs {

/// Sends messages of `level` and above to stderr through spdlog's default
/// logger. Replaces an earlier set-up.
void setup_log(LogLevel level);

/// Also writes the messages to `file`, appending. Throws DataError when the file cannot be written.
void add_log_file(const std::filesystem::path& file);

}  // namespace gs
