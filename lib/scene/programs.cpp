// SPDX-License-Identifier: Apache-2.0
// Runs programs, logs their output and converts their failures to errors; parses colmap's help and messages.
#include "lib/scene/programs.h"

#include <fmt/format.h>

#include <cerrno>
#include <regex>
#include <sstream>
#include <utility>

#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/core/process.h"
#include "lib/io/temporary.h"

namespace gs {
namespace {

/// Returns the output of colmap. Ignores failure, because some versions report failure for help.
std::string output_of(const std::vector<std::string>& arguments) {
    std::string text;
    try {
        run_process(arguments, {{"QT_QPA_PLATFORM", "offscreen"}},
                    [&](const std::string& line) { text += line + "\n"; });
        return text;
    } catch (const UsageError& e) {
        throw UsageError(std::string(e.what()) + "; install it with: apt-get install colmap");
    }
}

std::int64_t number(const std::ssub_match& digits) { return std::stoll(digits.str()); }

}  // namespace

ProgramLog::ProgramLog(std::filesystem::path file) : path_(std::move(file)), file_(path_) {
    if (!file_) fail_to_write("write", path_, errno);
}

void ProgramLog::run(const std::string& name, const std::vector<std::string>& arguments,
                     const std::function<void(const std::string&)>& on_line) {
    file_ << fmt::format("$ {}\n", fmt::join(arguments, " ")) << std::flush;
    ProcessResult result;
    try {
        // Debian's colmap is linked with Qt and needs a display even without windows.
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

ColmapProgram::ColmapProgram() {
    const std::string text = output_of({"colmap", "-h"});
    std::smatch match;
    version_ = std::regex_search(text, match, std::regex(R"(COLMAP \d[\w.\-]*)")) ? match.str() : "colmap";
    has_cuda_ = text.find("with CUDA") != std::string::npos;
}

const std::string& ColmapProgram::help(const std::string& command) {
    const auto [it, is_new] = helps_.try_emplace(command);
    if (is_new) it->second = output_of({"colmap", command, "-h"});
    return it->second;
}

std::string ColmapProgram::option(const std::string& command, const std::string& name) {
    std::istringstream words(help(command));
    for (std::string word; words >> word;)
        if (word.starts_with("--") && word.ends_with("." + name)) return word;
    return "";
}

std::optional<StageCount> count_in(const std::string& line) {
    static const std::regex kCount(R"(\[(\d{1,9})/(\d{1,9})(?:, (\d{1,9})/(\d{1,9}))?\])");
    std::smatch match;
    if (!std::regex_search(line, match, kCount)) return {};
    if (!match[3].matched) return StageCount{number(match[1]), number(match[2])};
    return StageCount{(number(match[1]) - 1) * number(match[4]) + number(match[3]),
                      number(match[2]) * number(match[4])};
}

std::optional<StageCount> registered_in(const std::string& line) {
    static const std::regex kRegistered(R"(Registering (?:image|frame) #.*\((?:\w+=)?(\d{1,9})\))");
    std::smatch match;
    if (!std::regex_search(line, match, kRegistered)) return {};
    return StageCount{number(match[1]), 0};
}

std::optional<double> reprojection_error_in(const std::string& line) {
    static const std::regex kError(R"(Mean reprojection error: (\d{1,9}(?:\.\d+)?)px)");
    std::smatch match;
    if (!std::regex_search(line, match, kError)) return {};
    return std::stod(match[1]);
}

}  // namespace gs
