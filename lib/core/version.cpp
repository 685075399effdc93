// SPDX-License-Identifier: Apache-2.0
// Returns the version and git hash that CMake recorded.
#include "lib/core/version.h"

namespace gs {

const char* version() { return GSAPP_VERSION; }

const char* git_hash() {
    return
#include "gsapp_git_hash.inc"
        ;
}

std::string version_text() {
    const std::string hash = git_hash();
    return std::string("gsapp ") + version() + (hash.empty() ? "" : " (" + hash + ")");
}

}  // namespace gs
