// SPDX-License-Identifier: Apache-2.0
// What the pages that gsapp writes have in common.
#pragma once

#include <string>

#include "eval/pages/text_table.h"

namespace gs {

/// eval/pages/page_head.html: everything before <body>, style included, with {{title}} to be filled in.
extern const char* const kPageHead;

/// kPageHead with its title.
std::string page_head(const std::string& title);

/// The table, with `note` (empty: none) below it, both escaped.
std::string html_table(const TextTable& table, const std::string& note);

/// Replaces the one place where {{key}} stands.
void fill(std::string& page, const std::string& key, const std::string& text);

}  // namespace gs
