// SPDX-License-Identifier: Apache-2.0
// Runs other programs and keeps all that they print in one file, and says what the installed `colmap` can do and what
// its messages mean. Its options were renamed between 3.8 and 4.x, so its own help is asked rather than its version.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace gs {

/// Runs other programs and keeps all that they print in one file.
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

/// What the installed `colmap` can do.
class ColmapProgram {
  public:
    /// Throws UsageError when colmap is not installed.
    ColmapProgram();

    const std::string& version() const { return version_; }  ///< "COLMAP 3.8"
    bool has_cuda() const { return has_cuda_; }
    /// Returns what `colmap command -h` prints.
    const std::string& help(const std::string& command);
    /// Returns the option of `command` whose name after the dot this is: for "use_gpu" of feature_extractor
    /// "--SiftExtraction.use_gpu" or, later, "--FeatureExtraction.use_gpu". Empty if there is none.
    std::string option(const std::string& command, const std::string& name);

  private:
    std::string version_;
    bool has_cuda_ = false;
    std::map<std::string, std::string> helps_;
};

/// How far a stage is.
struct StageCount {
    std::int64_t done = 0, total = 0;  ///< a total of 0 is not known
};

/// Reads "[3/67]", and "[2/3, 1/3]" of blocks of pairs as 4 of 9. Empty when the line holds no such count.
std::optional<StageCount> count_in(const std::string& line);

/// Reads the number of registered photographs in "Registering image #7 (5)", later "(num_reg_frames=5)". Empty for
/// other lines.
std::optional<StageCount> registered_in(const std::string& line);

/// Reads the pixels of "Mean reprojection error: 0.479041px". Empty for other lines.
std::optional<double> reprojection_error_in(const std::string& line);

}  // namespace gs
