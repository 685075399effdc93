// SPDX-License-Identifier: Apache-2.0
// Where tests find the data sets that the repository does not hold.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace gs::test {

/// Returns a data set's folder below the one that the environment variable GSAPP_TEST_DATA names, or an empty path
/// where the variable is not set or the folder is not there.
inline std::string test_data(const std::string& name) {
    const char* root = std::getenv("GSAPP_TEST_DATA");
    if (root == nullptr || *root == '\0') return "";
    const std::filesystem::path folder = std::filesystem::path(root) / name;
    return std::filesystem::is_directory(folder) ? folder.string() : "";
}

}  // namespace gs::test
