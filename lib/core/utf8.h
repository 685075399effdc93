// SPDX-License-Identifier: Apache-2.0
// Whether a text is UTF-8. Names of files are bytes, and older ones are often Latin-1.
#pragma once

#include <string_view>

namespace gs {

/// Returns true for well-formed UTF-8: no overlong forms, surrogates, or code points above U+10FFFF.
bool is_utf8(std::string_view text);

}  // namespace gs
