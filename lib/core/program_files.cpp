// SPDX-License-Identifier: Apache-2.0
// Finds files relative to the running program, located by /proc/self/exe.
#include "lib/core/program_files.h"

#include <fmt/format.h>

#include <system_error>

#include "kernels/base/error.h"

namespace gs {

namespace fs = std::filesystem;

fs::path shared_file(const std::string& name) {
    std::error_code error;
    const fs::path program = fs::read_symlink("/proc/self/exe", error);
    if (error) return {};
    const fs::path file = fs::canonical(program.parent_path().parent_path() / "share/gsapp" / name, error);
    return error ? fs::path() : file;
}

fs::path program_library(const std::string& name) {
    std::error_code error;
    const fs::path program = fs::read_symlink("/proc/self/exe", error);
    if (error) throw DeviceError(fmt::format("{} cannot be found: /proc/self/exe: {}", name, error.message()));
    const fs::path installed = program.parent_path().parent_path() / "lib/gsapp" / name;
    const fs::path beside = program.parent_path() / name;
    return !fs::exists(installed, error) && fs::exists(beside, error) ? beside : installed;
}

}  // namespace gs
