// SPDX-License-Identifier: Apache-2.0
// Checks UTF-8 by table 3-7 of the Unicode standard.
#include "lib/core/utf8.h"

#include <cstddef>

namespace gs {

bool is_utf8(std::string_view text) {
    for (std::size_t i = 0; i < text.size();) {
        const unsigned char lead = static_cast<unsigned char>(text[i++]);
        if (lead < 0x80) continue;
        if (lead < 0xC2 || lead > 0xF4) return false;
        const std::size_t following = lead < 0xE0 ? 1 : lead < 0xF0 ? 2 : 3;
        // Narrower bounds of the second byte rule out overlong forms, surrogates and what is above U+10FFFF.
        unsigned char low = lead == 0xE0 ? 0xA0 : lead == 0xF0 ? 0x90 : 0x80;
        unsigned char high = lead == 0xED ? 0x9F : lead == 0xF4 ? 0x8F : 0xBF;
        for (std::size_t k = 0; k < following; ++k, ++i) {
            if (i >= text.size()) return false;
            const unsigned char c = static_cast<unsigned char>(text[i]);
            if (c < low || c > high) return false;
            low = 0x80, high = 0xBF;
        }
    }
    return true;
}

}  // namespace gs
