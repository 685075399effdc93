// SPDX-License-Identifier: Apache-2.0
// Which gsapp this is, for --version and for the files it writes.
#pragma once

#include <string>

namespace gs {

/// "0.1.0".
const char* version();

/// Short hash of the commit it was built from, "-dirty" appended for changed files; empty when not known.
const char* git_hash();

/// "gsapp 0.1.0 (4f2a91c)", or without the parentheses.
std::string version_text();

}  // namespace gs
