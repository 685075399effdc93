// SPDX-License-Identifier: Apache-2.0
// What tests of file formats need: whole files as strings, and the message of an expected error.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "tests/core/temporary_folder.h"

namespace gs::test {

class TempFolder : public TemporaryFolder {
  public:
    std::filesystem::path operator/(const std::string& name) const { return path() / name; }
    std::size_t num_entries() const {
        return std::size_t(
            std::distance(std::filesystem::directory_iterator(path()), std::filesystem::directory_iterator()));
    }
};

inline std::string slurp(const std::filesystem::path& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

inline void spit(const std::filesystem::path& path, const std::string& bytes) {
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary) << bytes;
}

/// Runs `f`, which must throw E, and returns the message.
template <class E, class F> std::string message_of(F&& f) {
    try {
        f();
    } catch (const E& e) {
        return e.what();
    } catch (const std::exception& e) {
        ADD_FAILURE() << "another exception: " << e.what();
        return {};
    }
    ADD_FAILURE() << "nothing was thrown";
    return {};
}

}  // namespace gs::test

#define EXPECT_CONTAINS(text, part)                                                          \
    do {                                                                                     \
        const std::string contains_text = (text);                                            \
        EXPECT_NE(contains_text.find(part), std::string::npos) << "text: " << contains_text; \
    } while (false)
