// SPDX-License-Identifier: Apache-2.0
// The readers that are fuzzed. libFuzzer (fuzz_main.cpp) and the test of the corpus (corpus_test.cpp) run the same
// ones.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace gs::fuzz {

/// One reader of files.
struct Target {
    std::string_view name;                ///< the folder of its corpus, "colmap_cameras.bin"
    std::vector<std::string> (*seeds)();  ///< returns valid inputs
    /// Reads the input as the program would. Returns, or throws an error of kernels/base/error.h.
    void (*read)(const std::string& bytes);
};

std::vector<Target> scene_targets();   ///< COLMAP models, transforms.json, built-in scenes, test lists, points
std::vector<Target> image_targets();   ///< one for each format
std::vector<Target> model_targets();   ///< PLY, safetensors, checkpoints, ppisp.json, .ngsplat
std::vector<Target> run_targets();     ///< configuration, camera paths, results, the training log
std::vector<Target> server_targets();  ///< HTTP requests

/// Returns all targets.
std::vector<Target> targets();

/// How the reading of an input ended.
enum class Ending {
    kAccepted,  ///< without an error
    kRefused    ///< with an error of the project that has a message
};

/// Reads `bytes` and, where `reason` is given, writes why they were refused to it. Throws what is neither: other
/// exceptions, and std::logic_error for an error without a message.
Ending read(const Target& target, const std::string& bytes, std::string* reason = nullptr);

/// Returns the folder in which inputs become files; it is removed when the process ends.
const std::filesystem::path& folder();

/// Writes a file of that folder, with its parent folders, and returns its path.
std::filesystem::path put(const std::string& name, const std::string& bytes);

/// Returns what `write` puts into the file `name` of that folder.
std::string written(const std::string& name, const std::function<void(const std::filesystem::path&)>& write);

}  // namespace gs::fuzz
