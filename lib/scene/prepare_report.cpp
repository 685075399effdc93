// SPDX-License-Identifier: Apache-2.0
// Says what came of the photographs.
#include <fmt/format.h>

#include <algorithm>

#include "lib/scene/prepare.h"

namespace gs {
namespace {

/// Returns "12,345" for 12345.
std::string grouped(std::size_t n) {
    std::string digits = std::to_string(n);
    for (std::size_t i = digits.size(); i > 3; i -= 3) digits.insert(i - 3, ",");
    return digits;
}

}  // namespace

std::vector<std::string> describe(const PrepareReport& report) {
    constexpr std::size_t kShown = 10;
    const char* what = report.is_video ? "frames" : "photographs";
    std::vector<std::string> lines = {fmt::format("{} of {} {} registered, {} points", report.registered,
                                                  report.photographs, what, grouped(report.points))};
    if (report.error) lines[0] += fmt::format(", mean reprojection error {:.2g} px", *report.error);
    if (const auto& names = report.left_out; !names.empty()) {
        const std::vector<std::string> shown(names.begin(),
                                             names.begin() + std::ptrdiff_t(std::min(names.size(), kShown)));
        lines.push_back(fmt::format("left out: {}", fmt::join(shown, ", ")));
        if (names.size() > kShown) lines.back() += fmt::format(" and {} more", names.size() - kShown);
    }
    if (!report.other_models.empty())
        lines.push_back(
            fmt::format("colmap made {} reconstructions that do not connect: the largest is the scene; the others hold "
                        "{} {}",
                        report.other_models.size() + 1, fmt::join(report.other_models, ", "), what));
    lines.insert(lines.end(), report.notes.begin(), report.notes.end());
    return lines;
}

bool is_poor(const PrepareReport& report) { return report.registered * 10 < report.photographs * 9; }

}  // namespace gs
