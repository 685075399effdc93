// SPDX-License-Identifier: Apache-2.0
// Parses and formats durations as users write and read them: "2ms", "90s", "20m"; "12 min 05 s".
#pragma once

#include <string>

namespace gs {

/// Returns the seconds of a positive number with unit ms, s, m, min or h, or of several such in a row ("1h30m"). Throws
/// UsageError naming `where` and the text for anything else, and for more than a year.
double parse_duration(const std::string& text, const std::string& where);

/// Formats seconds: "3.2 s", "12 min 05 s", "2 h 40 min".
std::string duration_text(double seconds);

}  // namespace gs
