// SPDX-License-Identifier: Apache-2.0
// Reads colmap's help and messages.
#include "lib/scene/colmap_program.h"

#include <regex>
#include <sstream>

#include "kernels/base/error.h"
#include "lib/core/process.h"

namespace gs {
namespace {

/// Returns what colmap prints. Some versions report failure for help.
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
