// SPDX-License-Identifier: Apache-2.0
// Asks the kernel where the running program lies.
#include "lib/core/program_files.h"

#include <system_error>

namespace gs {

namespace fs = std::filesystem;

fs::path shared_file(const std::string& name) {
    std::error_code error;
    const fs::path program = fs::read_symlink("/proc/self/exe", error);
    if (error) return {};
    const fs::path file = fs::canonical(program.parent_path().parent_path() / "share/gsapp" / name, error);
    return error ? fs::path() : file;
}

}  // namespace gs
