// SPDX-License-Identifier: Apache-2.0
// The head, tables and placeholders of the HTML pages that gsapp writes.
#pragma once

#include <string>

#include "eval/pages/text_table.h"

namespace gs {

/// Text of eval/pages/page_head.html: everything before <body>, including the style, with the placeholder {{title}}.
extern const char* const kPageHead;

/// Returns kPageHead with the title filled in.
std::string page_head(const std::string& title);

/// Returns the table as HTML, with `note` below it unless it is empty. Both are escaped.
std::string html_table(const TextTable& table, const std::string& note);

/// Replaces the first {{key}} of the page, which must contain one.
void fill(std::string& page, const std::string& key, const std::string& text);

}  // namespace gs
