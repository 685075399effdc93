// SPDX-License-Identifier: Apache-2.0
// Builds the head of a page and HTML tables, and fills templates.
#include "eval/pages/html_page.h"

#include <fmt/format.h>

#include "eval/pages/escape.h"

namespace gs {
namespace {

std::string html_of(const TextCell& cell) {
    std::string text = html_escaped(cell.text);
    if (cell.place > 0)
        text = fmt::format("<span class=\"place{0}\">{1}<sup title=\"place {0}\">{0}</sup></span>", cell.place, text);
    return cell.deviation.empty() ? text : text + " &plusmn; " + html_escaped(cell.deviation);
}

}  // namespace

std::string page_head(const std::string& title) {
    std::string head = kPageHead;
    fill(head, "title", html_escaped(title));
    return head;
}

std::string html_table(const TextTable& table, const std::string& note) {
    std::string html = fmt::format(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" "
        "aria-label=\"{0}\">\n<table>\n<caption>{0}</caption>\n<thead><tr>",
        html_escaped(table.title));
    for (std::size_t c = 0; c < table.header.size(); ++c)
        html += fmt::format("<th scope=\"col\"{}>{}</th>", c < table.num_labels ? "" : " class=\"number\"",
                            html_escaped(table.header[c]));
    html += "</tr></thead>\n<tbody>\n";
    for (std::size_t i = 0; i < table.lines.size(); ++i) {
        const auto& line = table.lines[i];
        html += i < table.first_grey ? "<tr>" : "<tr class=\"grey\">";
        for (std::size_t c = 0; c < line.size(); ++c) {
            if (c == 0)
                html += fmt::format("<th scope=\"row\">{}</th>", html_of(line[c]));
            else
                html += fmt::format("<td{}>{}</td>", c < table.num_labels ? "" : " class=\"number\"", html_of(line[c]));
        }
        html += "</tr>\n";
    }
    html += "</tbody>\n</table>\n</div>\n";
    return note.empty() ? html : html + fmt::format("<p class=\"protocol\">{}</p>\n", html_escaped(note));
}

void fill(std::string& page, const std::string& key, const std::string& text) {
    const std::string mark = "{{" + key + "}}";
    page.replace(page.find(mark), mark.size(), text);
}

}  // namespace gs
