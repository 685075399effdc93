// SPDX-License-Identifier: Apache-2.0
// Sets up where messages go: stderr and the log file of the run folder. stdout belongs to results and progress lines.
#pragma once

#include <fmt/core.h>

#include <filesystem>

namespace gs {

enum class LogLevel { kDebug, kInfo, kWarn, kError };

/// Sends messages of `level` and above to stderr through spdlog's default logger. Replaces an earlier set-up.
void setup_log(LogLevel level);

/// Writes one message. The arguments come without their types, so that a call costs its unit no templates.
void log_message(LogLevel level, fmt::string_view format, fmt::format_args arguments);

/// Write a message, formatted as by fmt::format.
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

/// Appends the messages to `file` as well, those of level debug included, whatever stderr shows. Throws DataError when
/// the file cannot be opened. That it cannot be written later is said once, on stderr.
void add_log_file(const std::filesystem::path& file);

}  // namespace gs
