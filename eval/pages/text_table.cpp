// SPDX-License-Identifier: Apache-2.0
// Writes tables as text.
#include "eval/pages/text_table.h"

#include <fmt/format.h>

#include <algorithm>

#include "eval/pages/escape.h"

namespace gs {
namespace {

std::string escaped(const std::string& text, TableStyle style) {
    return style == TableStyle::kMarkdown ? markdown_escaped(text) : one_line(text);
}

std::string text_of(const TextCell& cell, TableStyle style) {
    static constexpr const char* kBefore[] = {"", "**", "<u>", "*"};
    static constexpr const char* kAfter[] = {"", "**", "</u>", "*"};
    const int place = style == TableStyle::kMarkdown ? cell.place : 0;
    std::string text = kBefore[place] + escaped(cell.text, style) + kAfter[place];
    return cell.deviation.empty() ? text : text + " ± " + escaped(cell.deviation, style);
}

/// Counts the code points of UTF-8 text.
std::size_t width_of(const std::string& text) {
    return std::size_t(std::count_if(text.begin(), text.end(), [](unsigned char c) { return (c & 0xC0) != 0x80; }));
}

}  // namespace

std::string table_text(const TextTable& table, TableStyle style) {
    std::vector<std::vector<std::string>> lines(1);
    for (const std::string& title : table.header) lines[0].push_back(escaped(title, style));
    for (const auto& line : table.lines) {
        lines.emplace_back();
        for (const TextCell& cell : line) lines.back().push_back(text_of(cell, style));
    }
    std::vector<std::size_t> widths(table.header.size(), 3);
    for (const auto& line : lines)
        for (std::size_t c = 0; c < line.size(); ++c) widths[c] = std::max(widths[c], width_of(line[c]));
    std::string text = table.title.empty() ? "" : title_text(table.title, style);
    for (std::size_t i = 0; i < lines.size(); ++i) {
        text += "|";
        for (std::size_t c = 0; c < widths.size(); ++c) {
            const std::string padding(widths[c] - width_of(lines[i][c]), ' ');
            text += c < table.num_labels ? fmt::format(" {}{} |", lines[i][c], padding)
                                         : fmt::format(" {}{} |", padding, lines[i][c]);
        }
        text += "\n";
        if (i > 0) continue;
        text += "|";
        for (std::size_t c = 0; c < widths.size(); ++c)
            text += fmt::format(" {}{} |", std::string(widths[c] - 1, '-'), c < table.num_labels ? "-" : ":");
        text += "\n";
    }
    return text;
}

std::string markdown_table(const TextTable& table) { return table_text(table, TableStyle::kMarkdown); }
std::string terminal_table(const TextTable& table) { return table_text(table, TableStyle::kTerminal); }

std::string title_text(const std::string& title, TableStyle style) {
    return (style == TableStyle::kMarkdown ? "### " : "") + escaped(title, style) + "\n\n";
}

std::string emphasized(const std::string& word, TableStyle style) {
    return style == TableStyle::kMarkdown ? "**" + word + "**" : word;
}

}  // namespace gs
