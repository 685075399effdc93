// SPDX-License-Identifier: Apache-2.0
// Texts as Unicode: whether bytes are UTF-8, and what makes two spellings of a name the same. Names of files are bytes;
// those of older archives are often Latin-1 or GBK.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gs {

/// Returns true for well-formed UTF-8: no overlong forms, surrogates, or code points above U+10FFFF.
bool is_utf8(std::string_view text);

/// Returns the text in Unicode's composed form (NFC), in which "e" with a combining accent is one character. macOS
/// writes names in the decomposed form. What is not UTF-8 comes back unchanged.
std::string composed(std::string_view text);

/// Returns the text composed and without the difference between upper and lower case; of what is not UTF-8 only the
/// letters of ASCII lose it.
std::string case_folded(std::string_view text);

/// Bytes taken for an encoding other than UTF-8.
struct Reading {
    const char* encoding;
    std::string text;  ///< UTF-8
};

/// Returns the readings of a text that is not UTF-8 in the encodings that zip archives and older systems use, likely
/// ones first; nothing for UTF-8.
std::vector<Reading> readings(std::string_view bytes);

/// Returns the number of bytes of the code point at `at`; 0 if the byte there begins none.
std::size_t utf8_length(std::string_view text, std::size_t at);

/// Returns `text` to be looked at: U+FFFD for each byte that is no part of UTF-8. Different texts may become the same.
std::string printable(std::string_view text);

}  // namespace gs
