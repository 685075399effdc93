// SPDX-License-Identifier: Apache-2.0
// The entry of libFuzzer. `fuzz --list` prints the targets, `fuzz --seeds=DIR` writes their seeds to DIR/TARGET/, and
// `fuzz --target=NAME [libFuzzer's arguments]` fuzzes one.
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <optional>
#include <string>

#include "lib/core/log.h"
#include "lib/io/image_module.h"
#include "tests/fuzz/target.h"

namespace {

std::optional<gs::fuzz::Target> chosen;

/// Returns the rest of an argument that begins with `prefix`.
std::optional<std::string> rest_of(const std::string& argument, const std::string& prefix) {
    return argument.starts_with(prefix) ? std::optional(argument.substr(prefix.size())) : std::nullopt;
}

void write_seeds(const std::filesystem::path& folder) {
    for (const gs::fuzz::Target& target : gs::fuzz::targets()) {
        std::filesystem::create_directories(folder / target.name);
        int number = 0;
        for (const std::string& bytes : target.seeds())
            std::ofstream(folder / target.name / ("seed" + std::to_string(number++)), std::ios::binary) << bytes;
    }
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv);
extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
    gs::setup_log(gs::LogLevel::kError);
    int kept = 1;
    for (int i = 1; i < *argc; ++i) {
        const std::string argument = (*argv)[i];
        if (argument == "--list") {
            for (const gs::fuzz::Target& target : gs::fuzz::targets()) std::cout << target.name << "\n";
            std::exit(0);
        }
        if (const auto folder = rest_of(argument, "--seeds=")) {
            write_seeds(*folder);
            std::exit(0);
        }
        if (const auto name = rest_of(argument, "--target=")) {
            for (const gs::fuzz::Target& target : gs::fuzz::targets())
                if (target.name == *name) chosen = target;
        } else {
            (*argv)[kept++] = (*argv)[i];
        }
    }
    *argc = kept;
    gs::image_module();  // before inputs are timed
    if (chosen) return 0;
    std::cerr << "fuzz: --target=NAME is missing, or names none of those that --list prints\n";
    std::exit(2);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    gs::fuzz::read(*chosen, std::string(reinterpret_cast<const char*>(data), size));
    return 0;
}
