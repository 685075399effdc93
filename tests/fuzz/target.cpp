// SPDX-License-Identifier: Apache-2.0
// What the targets share: the list of all, files for inputs, and how a reading may end.
#include "tests/fuzz/target.h"

#include <fstream>
#include <iterator>
#include <stdexcept>

#include "kernels/base/error.h"
#include "tests/core/temporary_folder.h"

namespace gs::fuzz {

namespace fs = std::filesystem;

std::vector<Target> targets() {
    std::vector<Target> all;
    for (const auto& part : {scene_targets(), image_targets(), model_targets(), run_targets(), server_targets()})
        all.insert(all.end(), part.begin(), part.end());
    return all;
}

Ending read(const Target& target, const std::string& bytes, std::string* reason) {
    try {
        target.read(bytes);
        return Ending::kAccepted;
    } catch (const Error& error) {
        if (std::string(error.what()).empty()) throw std::logic_error("an error without a message");
        if (reason) *reason = error.what();
        return Ending::kRefused;
    }
}

const fs::path& folder() {
    static const test::TemporaryFolder folder;
    return folder.path();
}

fs::path put(const std::string& name, const std::string& bytes) {
    const fs::path path = folder() / name;
    fs::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
}

std::string written(const std::string& name, const std::function<void(const fs::path&)>& write) {
    const fs::path path = folder() / name;
    fs::create_directories(path.parent_path());
    write(path);
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace gs::fuzz
