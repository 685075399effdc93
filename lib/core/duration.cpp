// SPDX-License-Identifier: Apache-2.0
// Parses and formats durations.
#include "lib/core/duration.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>

#include "kernels/base/error.h"

namespace gs {
namespace {

constexpr double kYear = 365.0 * 86400;  // limit, because longer times do not fit into a clock's count

/// Returns the seconds of a unit, 0 for an unknown one.
double unit_seconds(const std::string& unit) {
    if (unit == "ms") return 1e-3;
    if (unit == "s") return 1;
    if (unit == "m" || unit == "min") return 60;
    return unit == "h" ? 3600 : 0;
}

}  // namespace

double parse_duration(const std::string& text, const std::string& where) {
    const auto wrong = [&] {
        return UsageError(fmt::format("{}: '{}' is not a duration; write 90s, 20m, 2h, 1h30m or 2ms", where, text));
    };
    constexpr const char* kNumber = "0123456789.";
    double seconds = 0;
    for (std::size_t at = 0; at < text.size();) {
        double number = 0;
        const auto [end, error] =
            std::from_chars(text.data() + at, text.data() + text.size(), number, std::chars_format::fixed);
        const std::size_t unit = std::size_t(end - text.data());
        if (error != std::errc{} || !(number >= 0)) throw wrong();
        if (at == 0 && unit == text.size() && number > 0 && std::isfinite(number))
            throw UsageError(fmt::format("{0}: {1} of what? Write {1}ms, {1}s, {1}m or {1}h", where, text));
        at = std::min(text.find_first_of(kNumber, unit), text.size());
        const double factor = unit_seconds(text.substr(unit, at - unit));
        if (factor == 0) throw wrong();
        seconds += factor * number;
    }
    if (!(seconds > 0 && seconds <= kYear)) throw wrong();
    return seconds;
}

std::string duration_text(double seconds) {
    const auto rounded = std::int64_t(std::lround(seconds));
    if (rounded < 60) return fmt::format("{:.1f} s", seconds);
    if (rounded < 3600) return fmt::format("{} min {:02} s", rounded / 60, rounded % 60);
    return fmt::format("{} h {:02} min", rounded / 3600, rounded / 60 % 60);
}

}  // namespace gs
