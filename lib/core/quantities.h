// SPDX-License-Identifier: Apache-2.0
// Durations and byte sizes, and their texts for users: "2ms", "90s", "1h30m"; "4GiB", "500 MB".
#pragma once

#include <compare>
#include <cstdint>
#include <string>
#include <string_view>

namespace gs {

struct Duration {
    double seconds = 0;

    /// Returns the shortest text from which parse_duration restores the same value: "2ms", "90s", "20m".
    std::string text() const;
    auto operator<=>(const Duration&) const = default;
};

struct ByteCount {
    std::uint64_t count = 0;

    /// Returns the shortest text from which parse_bytes restores the same value: "4GiB", "500MB", "7B", "0".
    std::string text() const;
    auto operator<=>(const ByteCount&) const = default;
};

/// Parses a positive number with unit ms, s, m, min or h, or a sequence of them ("1h30m"). Throws UsageError naming
/// `where` and the text for anything else, and for more than a year.
Duration parse_duration(const std::string& text, const std::string& where);

/// Formats seconds for people: "3.2 s", "12 min 05 s", "2 h 40 min".
std::string duration_text(double seconds);

/// Parses a non-negative number and its unit, case-insensitively. KiB, MiB, GiB, TiB and the single letters K, M, G, T
/// are powers of 1024; KB, MB, GB, TB are powers of 1000; B is bytes; 0 needs no unit. Fractions are allowed ("1.5GiB",
/// rounded down). Throws UsageError naming `where` and the text for anything else, and for values of 2^63 or more.
ByteCount parse_bytes(std::string_view text, const std::string& where);

}  // namespace gs
