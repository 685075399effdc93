// SPDX-License-Identifier: Apache-2.0
// Unicode functions: validation of UTF-8, and normal forms to compare spellings of a name. File names are bytes; in
// older archives they are often Latin-1 or GBK.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// Returns whether `text` is well-formed UTF-8: no overlong forms, surrogates, or code points above U+10FFFF.
bool is_utf8(std::string_view text);

/// Returns the text in Unicode's composed form (NFC), in which "e" with a combining accent is one character. macOS
/// writes names in the decomposed form. A text that is not UTF-8 is returned unchanged.
std::string composed(std::string_view text);

/// Returns the text composed and case-folded. In a text that is not UTF-8 only ASCII letters are folded.
std::string case_folded(std::string_view text);

/// An interpretation of bytes in an encoding other than UTF-8.
struct Reading {
    const char* encoding;
    std::string text;  ///< UTF-8
};

/// Returns the readings of a text that is not UTF-8 in the encodings that zip archives and older systems use, most
/// likely first; none for a UTF-8 text.
std::vector<Reading> readings(std::string_view bytes);

/// Returns the number of bytes of the code point at `at`; 0 if no valid code point begins there.
std::size_t utf8_length(std::string_view text, std::size_t at);

/// Returns `text` for display, with U+FFFD for each byte that is not part of valid UTF-8. Different texts may become
/// equal.
std::string printable(std::string_view text);

}  // namespace gs
