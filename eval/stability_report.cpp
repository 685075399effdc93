// SPDX-License-Identifier: Apache-2.0
// The stability table as text.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>

#include "eval/stability.h"

namespace gs {
namespace {

constexpr int kColumns = 11, kFirstNumber = 2, kLastNumber = 9;
using Cells = std::array<std::string, kColumns>;

Cells cells(const StabilityRow& r) {
    return {r.model,
            r.kind,
            fmt::format("{}", r.cases),
            fmt::format("{:.1e}", r.forward_error),
            fmt::format("{:.1e}", r.backward_error),
            fmt::format("{:.1f}", r.ulp),
            fmt::format("{:.1e}", r.double_error),
            fmt::format("{}", r.num_nonfinite),
            fmt::format("{}", r.num_sign_flips),
            fmt::format("{}", r.num_wrong_limits),
            r.limit};
}

}  // namespace

std::string format_stability(const std::vector<StabilityRow>& rows) {
    std::vector<Cells> lines = {{"model", "input", "cases", "forward", "backward", "ULP", "double", "non-finite", "sign flips", "wrong limits", "limit reached"}};
    for (const StabilityRow& row : rows) lines.push_back(cells(row));
    std::array<std::size_t, kColumns> widths{};
    for (const Cells& line : lines)
        for (int c = 0; c < kColumns; ++c) widths[c] = std::max(widths[c], line[c].size());
    std::string text;
    for (const Cells& line : lines) {
        text += "|";
        for (int c = 0; c < kColumns; ++c)
            text += c < kFirstNumber || c > kLastNumber ? fmt::format(" {:<{}} |", line[c], widths[c]) : fmt::format(" {:>{}} |", line[c], widths[c]);
        text += "\n";
        if (&line != &lines.front()) continue;
        text += "|";
        for (int c = 0; c < kColumns; ++c) text += c < kFirstNumber || c > kLastNumber ? fmt::format(" {:-<{}} |", "", widths[c]) : fmt::format(" {:->{}} |", ":", widths[c]);
        text += "\n";
    }
    return text;
}

}  // namespace gs
