// SPDX-License-Identifier: Apache-2.0
// Parses and formats durations and byte sizes.
#include "lib/core/quantities.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>

#include "kernels/base/error.h"

namespace gs {
namespace {

constexpr double kYear = 365.0 * 86400;  // limit in seconds, because longer times overflow a clock's counter

/// Returns the seconds of a unit, 0 for an unknown one.
double unit_seconds(const std::string& unit) {
    if (unit == "ms") return 1e-3;
    if (unit == "s") return 1;
    if (unit == "m" || unit == "min") return 60;
    return unit == "h" ? 3600 : 0;
}

}  // namespace

Duration parse_duration(const std::string& text, const std::string& where) {
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
    return {seconds};
}

std::string duration_text(double seconds) {
    const auto rounded = std::int64_t(std::lround(seconds));
    if (rounded < 60) return fmt::format("{:.1f} s", seconds);
    if (rounded < 3600) return fmt::format("{} min {:02} s", rounded / 60, rounded % 60);
    return fmt::format("{} h {:02} min", rounded / 3600, rounded / 60 % 60);
}

std::string Duration::text() const {
    const auto reads_back = [&](const std::string& text) { return parse_duration(text, "").seconds == seconds; };
    for (const auto& [unit, factor] : {std::pair{"h", 3600.0}, {"m", 60.0}}) {
        const double number = seconds / factor;
        if (number == std::floor(number)) return fmt::format("{}{}", number, unit);
    }
    const std::string milliseconds = fmt::format("{}ms", seconds * 1e3);
    return seconds < 0.1 && reads_back(milliseconds) ? milliseconds : fmt::format("{}s", seconds);
}

ByteCount parse_bytes(std::string_view text, const std::string& where) {
    const auto fail = [&](const char* why) {
        return UsageError(fmt::format("{}: byte size '{}': {} (examples: 4GiB, 500MB, 0)", where, text, why));
    };
    std::string_view rest = text;
    while (!rest.empty() && std::isspace(static_cast<unsigned char>(rest.front()))) rest.remove_prefix(1);
    while (!rest.empty() && std::isspace(static_cast<unsigned char>(rest.back()))) rest.remove_suffix(1);

    const std::string_view trimmed = rest;
    double number = 0;
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), number, std::chars_format::fixed);
    if (error != std::errc()) throw fail("does not start with a number");
    if (!std::isfinite(number) || std::signbit(number)) throw fail("must be a finite number of at least 0");
    rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));

    std::string unit;
    for (const char c : rest)
        if (!std::isspace(static_cast<unsigned char>(c)))
            unit += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));

    double factor = 1;
    if (unit.empty() && number > 0)
        throw UsageError(fmt::format("{0}: byte size '{1}': {1} of what? Write {1}GiB, {1}MB or {1}B", where, trimmed));
    if (!unit.empty() && unit != "b") {
        const std::size_t power = std::string_view("kmgt").find(unit[0]);
        const std::string_view suffix = std::string_view(unit).substr(1);
        if (power == std::string_view::npos || !(suffix.empty() || suffix == "b" || suffix == "ib"))
            throw fail("has an unknown unit");
        factor = std::pow(suffix == "b" ? 1000.0 : 1024.0, static_cast<double>(power + 1));
    }
    const double bytes = std::floor(number * factor);
    if (bytes >= 9223372036854775808.0) throw fail("is too large");
    return {static_cast<std::uint64_t>(bytes)};
}

std::string ByteCount::text() const {
    if (count == 0) return "0";
    constexpr std::array kUnits = {"B", "K", "M", "G", "T"};
    for (std::size_t power = 4; power > 0; --power)
        for (const auto& [base, suffix] : {std::pair<std::uint64_t, const char*>{1024, "iB"}, {1000, "B"}}) {
            std::uint64_t unit = 1;
            for (std::size_t k = 0; k < power; ++k) unit *= base;
            if (count % unit == 0) return fmt::format("{}{}{}", count / unit, kUnits[power], suffix);
        }
    return fmt::format("{}B", count);
}

}  // namespace gs
