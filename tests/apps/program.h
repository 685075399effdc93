// SPDX-License-Identifier: Apache-2.0
// Runs the built gsapp as a user would, in a folder of its own.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <map>
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
        return shell(before + " " + call(arguments));
    }

    /// Sends SIGINT once `sign` is among what the program has printed, however slow the machine is; after two minutes
    /// in any case.
    Outcome interrupt(const std::string& arguments, const std::string& sign) const {
        return shell(call(arguments) + " & program=$!; for i in $(seq 1200); do grep -q '" + sign +
                     "' out.txt err.txt && break; sleep 0.1; done; kill -INT $program; wait $program");
    }

    /// Trains `folder` on the CPU, or copies the run that an earlier test of this process trained by the same
    /// arguments: trainings repeat themselves to the bit.
    void train(const std::string& folder, const std::string& arguments) const {
        static std::map<std::string, TemporaryFolder> trained;
        const auto [kept, is_new] = trained.try_emplace(folder + " " + arguments);
        if (is_new) {
            const Outcome outcome = run("train --device cpu --quiet -m " + folder + " " + arguments);
            ASSERT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.err;
        }
        const std::filesystem::path copy = kept->second.path() / folder;
        std::filesystem::copy(is_new ? path(folder) : copy, is_new ? copy : path(folder),
                              std::filesystem::copy_options::recursive);
    }

    std::string read(const std::string& name) const {
        std::ifstream file(path(name), std::ios::binary);
        return {std::istreambuf_iterator<char>(file), {}};
    }

  private:
    static std::string call(const std::string& arguments) {
        return "'" GSAPP_PROGRAM "' " + arguments + " >out.txt 2>err.txt";
    }

    Outcome shell(const std::string& command) const {
        const int status = std::system(("cd '" + folder_.path().string() + "' || exit 1; " + command).c_str());
        Outcome outcome;
        if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
        outcome.out = read("out.txt");
        outcome.err = read("err.txt");
        return outcome;
    }

    TemporaryFolder folder_;
};

}  // namespace gs::test
