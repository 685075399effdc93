// SPDX-License-Identifier: Apache-2.0
// The version of gsapp, for --version and for the files it writes.
#pragma once

#include <string>

namespace gs {

/// Returns the version, e.g. "0.3.0".
const char* version();

/// Returns the short hash of the commit of the build, with "-dirty" appended if files were changed; empty if unknown.
const char* git_hash();

/// Returns e.g. "gsapp 0.3.0 (4f2a91c)", without the parentheses if the hash is unknown.
std::string version_text();

}  // namespace gs
