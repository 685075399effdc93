// SPDX-License-Identifier: Apache-2.0
// Sets up spdlog with two sinks.
#include "lib/core/log.h"

#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "kernels/base/error.h"

namespace gs {

namespace {

spdlog::level::level_enum level_of(LogLevel level) {
    constexpr spdlog::level::level_enum kLevels[] = {spdlog::level::debug, spdlog::level::info, spdlog::level::warn,
                                                     spdlog::level::err};
    return kLevels[int(level)];
}

}  // namespace

void setup_log(LogLevel level) {
    auto sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
    // On a terminal a message first erases the progress line; the bar is then redrawn below the message.
    sink->set_pattern(::isatty(STDERR_FILENO) != 0 ? "\r\033[K%^%l%$: %v" : "%l: %v");
    if (const char* no_color = std::getenv("NO_COLOR"); no_color && *no_color)  // https://no-color.org
        sink->set_color_mode(spdlog::color_mode::never);
    auto logger = std::make_shared<spdlog::logger>("gsapp", sink);
    const auto shown = level_of(level);
    sink->set_level(shown);
    logger->set_level(shown);
    logger->flush_on(spdlog::level::info);
    // Writing the log file may fail, e.g. on a full disk, which must not end a run.
    logger->set_error_handler([](const std::string& reason) {
        static std::atomic<bool> said = false;
        if (!said.exchange(true)) fmt::print(stderr, "warning: {}; messages may be missing there\n", reason);
    });
    spdlog::set_default_logger(logger);
}

void log_message(LogLevel level, fmt::string_view format, fmt::format_args arguments) {
    if (spdlog::should_log(level_of(level))) spdlog::log(level_of(level), "{}", fmt::vformat(format, arguments));
}

void add_log_file(const std::filesystem::path& file) {
    try {
        auto sink = std::make_shared<spdlog::sinks::basic_file_sink_mt>(file.string());
        sink->set_pattern("%Y-%m-%d %H:%M:%S %l: %v");
        auto logger = spdlog::default_logger();
        logger->sinks().push_back(sink);
        logger->set_level(std::min(logger->level(), spdlog::level::debug));
    } catch (const spdlog::spdlog_ex& e) {
        throw DataError("cannot write the log file " + file.string() + ": " + e.what());
    }
}

}  // namespace gs
