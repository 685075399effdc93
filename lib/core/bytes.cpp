// SPDX-License-Identifier: Apache-2.0
// Parses byte sizes as users write them: "4GiB", "500 MB".
#include "lib/core/bytes.h"

#include <fmt/format.h>

#include <cctype>
#include <charconv>
#include <cmath>
#include <string>

#include "kernels/base/error.h"

namespace gs {

std::uint64_t parse_bytes(std::string_view text) {
    const auto fail = [&](const char* why) {
        return UsageError(fmt::format("byte size '{}': {} (examples: 4GiB, 500MB, 0)", text, why));
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
        throw UsageError(fmt::format("byte size '{0}': {0} of what? Write {0}GiB, {0}MB or {0}B", trimmed));
    if (!unit.empty() && unit != "b") {
        const std::size_t power = std::string_view("kmgt").find(unit[0]);
        const std::string_view suffix = std::string_view(unit).substr(1);
        if (power == std::string_view::npos || !(suffix.empty() || suffix == "b" || suffix == "ib"))
            throw fail("has an unknown unit");
        factor = std::pow(suffix == "b" ? 1000.0 : 1024.0, static_cast<double>(power + 1));
    }
    const double bytes = std::floor(number * factor);
    if (bytes >= 9223372036854775808.0) throw fail("is too large");
    return static_cast<std::uint64_t>(bytes);
}

}  // namespace gs
