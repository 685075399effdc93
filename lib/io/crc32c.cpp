// SPDX-License-Identifier: Apache-2.0
// Computes CRC-32C byte by byte, from a table.
#include "lib/io/crc32c.h"

#include <array>

namespace gs {
namespace {

constexpr std::uint32_t kReflectedPolynomial = 0x82F63B78;

constexpr std::array<std::uint32_t, 256> make_table() {
    std::array<std::uint32_t, 256> table{};
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
        std::uint32_t value = byte;
        for (int bit = 0; bit < 8; ++bit) value = value >> 1 ^ ((value & 1) != 0 ? kReflectedPolynomial : 0);
        table[byte] = value;
    }
    return table;
}

}  // namespace

std::uint32_t crc32c(std::string_view bytes) {
    static constexpr std::array<std::uint32_t, 256> kTable = make_table();
    std::uint32_t crc = ~0u;
    for (const char c : bytes) crc = crc >> 8 ^ kTable[(crc ^ std::uint8_t(c)) & 255];
    return ~crc;
}

}  // namespace gs
