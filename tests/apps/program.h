// SPDX-License-Identifier: Apache-2.0
// Runs the built gsapp as a user would, in a folder of its own.
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "tests/core/temporary_folder.h"

namespace gs::test {

struct Outcome {
    int exit_code = -1;
    std::string out, err;
};

/// A working folder in which the program is called.
class Program {
  public:
    const TemporaryFolder& folder() const { return folder_; }
    std::filesystem::path path(const std::string& name) const { return folder_.path() / name; }

    /// `arguments` as typed in a shell; `before` is put in front of the program ("timeout 5").
    Outcome run(const std::string& arguments, const std::string& before = "") const {
        const std::string command = "cd '" + folder_.path().string() + "' && " + before + " '" GSAPP_PROGRAM "' " +
                                    arguments + " >out.txt 2>err.txt";
        const int status = std::system(command.c_str());
        Outcome outcome;
        if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
        outcome.out = read("out.txt");
        outcome.err = read("err.txt");
        return outcome;
    }

    std::string read(const std::string& name) const {
        std::ifstream file(path(name), std::ios::binary);
        return {std::istreambuf_iterator<char>(file), {}};
    }

  private:
    TemporaryFolder folder_;
};

}  // namespace gs::test
