// SPDX-License-Identifier: Apache-2.0
// Escapes for HTML, Markdown, LaTeX and CSV.
#include "eval/pages/escape.h"

#include <cstring>

#include "lib/core/utf8.h"

namespace gs {
namespace {

/// Returns printable text with every character replaced by the text that `replacement` returns for it; a null pointer
/// keeps the character.
template <class Replacement> std::string replaced(const std::string& text, const Replacement& replacement) {
    std::string out;
    for (const char c : printable(text)) {
        if (const char* with = replacement(c))
            out += with;
        else
            out += c;
    }
    return out;
}

}  // namespace

std::string one_line(const std::string& text) {
    return replaced(text, [](char c) { return std::strchr("\n\r\t", c) && c != '\0' ? " " : nullptr; });
}

std::string markdown_escaped(const std::string& text) {
    return replaced(one_line(text), [](char c) -> const char* {
        switch (c) {
            case '|':
                return "\\|";
            case '*':
                return "\\*";
            case '`':
                return "\\`";
            case '\\':
                return "\\\\";
            case '<':
                return "&lt;";
            case '&':
                return "&amp;";
            default:
                return nullptr;
        }
    });
}

std::string csv_escaped(const std::string& text) {
    if (text.find_first_of(",\"\n\r") == std::string::npos) return printable(text);
    return "\"" + replaced(text, [](char c) { return c == '"' ? "\"\"" : nullptr; }) + "\"";
}

std::string latex_escaped(const std::string& text) {
    return replaced(one_line(text), [](char c) -> const char* {
        switch (c) {
            case '\\':
                return "\\textbackslash{}";
            case '~':
                return "\\textasciitilde{}";
            case '^':
                return "\\textasciicircum{}";
            case '<':
                return "\\textless{}";
            case '>':
                return "\\textgreater{}";
            case '&':
                return "\\&";
            case '%':
                return "\\%";
            case '$':
                return "\\$";
            case '#':
                return "\\#";
            case '_':
                return "\\_";
            case '{':
                return "\\{";
            case '}':
                return "\\}";
            default:
                return nullptr;
        }
    });
}

std::string html_escaped(const std::string& text) {
    return replaced(text, [](char c) -> const char* {
        switch (c) {
            case '<':
                return "&lt;";
            case '>':
                return "&gt;";
            case '&':
                return "&amp;";
            case '"':
                return "&quot;";
            case '\'':
                return "&#39;";
            default:
                return nullptr;
        }
    });
}

}  // namespace gs
