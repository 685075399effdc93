// SPDX-License-Identifier: Apache-2.0
// Parses byte sizes as users write them: "4GiB", "500 MB".
#pragma once

#include <cstdint>
#include <string_view>

namespace gs {

/// Parses a non-negative number and its unit, case-insensitive, and returns bytes. KiB, MiB, GiB, TiB and the single
/// letters K, M, G, T are powers of 1024; KB, MB, GB, TB are powers of 1000; B is bytes; 0 needs no unit. Fractions are
/// allowed ("1.5GiB", rounded down). Throws UsageError naming the text for anything else, and for values
/// of 2^63 and more.
std::uint64_t parse_bytes(std::string_view text);

}  // namespace gs
