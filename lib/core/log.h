// SPDX-License-Identifier: Apache-2.0
// Logging to stderr and to the log file of the run folder. stdout is reserved for results and progress lines.
#pragma once

#include <fmt/core.h>

#include <filesystem>

namespace gs {

enum class LogLevel { kDebug, kInfo, kWarn, kError };

/// Sends messages of `level` and above to stderr through spdlog's default logger. Replaces an earlier setup.
void setup_log(LogLevel level);

/// Writes one message. The arguments are type-erased, so that calls instantiate no templates in their translation
/// units.
void log_message(LogLevel level, fmt::string_view format, fmt::format_args arguments);

/// Write one message, formatted as by fmt::format.
template <class... Args> void log_debug(fmt::format_string<Args...> format, Args&&... args) {
    log_message(LogLevel::kDebug, format, fmt::make_format_args(args...));
}
template <class... Args> void log_info(fmt::format_string<Args...> format, Args&&... args) {
    log_message(LogLevel::kInfo, format, fmt::make_format_args(args...));
}
template <class... Args> void log_warning(fmt::format_string<Args...> format, Args&&... args) {
    log_message(LogLevel::kWarn, format, fmt::make_format_args(args...));
}
template <class... Args> void log_error(fmt::format_string<Args...> format, Args&&... args) {
    log_message(LogLevel::kError, format, fmt::make_format_args(args...));
}

/// Also appends all messages to `file`, including level debug, whatever level stderr shows. Throws DataError if the
/// file cannot be opened. A later write error is reported once, on stderr.
void add_log_file(const std::filesystem::path& file);

}  // namespace gs
