// SPDX-License-Identifier: Apache-2.0
// Finds the files that belong to the program, regardless of its place of installation.
#pragma once

#include <filesystem>
#include <string>

namespace gs {

/// Returns the path of `name` ("viewer") in the folder ../share/gsapp beside the folder of the running program, without
/// symbolic links; an empty path if there is none. The build tree has the same layout, with links to the sources.
std::filesystem::path shared_file(const std::string& name);

/// Returns the path of the program's library `name`: in ../lib/gsapp beside the folder of the running program, or in
/// that folder itself if only that exists. The path need not exist. Throws DeviceError if the path of the running
/// program cannot be determined.
std::filesystem::path program_library(const std::string& name);

}  // namespace gs
