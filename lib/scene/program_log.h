// SPDX-License-Identifier: Apache-2.0
// Runs other programs and keeps all that they print in one file.
#pragma once

#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

namespace gs {

class ProgramLog {
  public:
    /// Throws DataError when the file cannot be opened.
    explicit ProgramLog(std::filesystem::path file);

    /// Runs `arguments[0]`, which messages call `name`, and calls `on_line` with each line that it prints. Throws
    /// UsageError when it is not installed, DataError with its last lines when it fails, Interrupted when the user
    /// stopped it.
    void run(const std::string& name, const std::vector<std::string>& arguments,
             const std::function<void(const std::string&)>& on_line);

    const std::filesystem::path& path() const { return path_; }
    /// Returns whether a program was started.
    bool has_runs() const { return has_runs_; }

  private:
    std::filesystem::path path_;
    std::ofstream file_;
    bool has_runs_ = false;
};

}  // namespace gs
