// SPDX-License-Identifier: Apache-2.0
// CRC-32C (Castagnoli), the checksum of TFRecord files.
#pragma once

#include <cstdint>
#include <string_view>

namespace gs {

/// Returns the CRC-32C of the bytes: polynomial 0x1EDC6F41, reflected, begun with and inverted by all ones, as RFC 3720
/// (appendix B.4) has it with test vectors.
std::uint32_t crc32c(std::string_view bytes);

}  // namespace gs
