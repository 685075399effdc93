// SPDX-License-Identifier: Apache-2.0
// Runs other programs and logs their output, finds the options of the installed `colmap`, and parses its progress
// messages. colmap's options were renamed between 3.8 and 4.x, so they are read from its help instead of inferred from
// its version.
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

/// Runs other programs and collects their output in one file.
class ProgramLog {
  public:
    /// Throws DataError if the file cannot be opened.
    explicit ProgramLog(std::filesystem::path file);

    /// Runs the program `arguments[0]`, called `name` in messages, and calls `on_line` with each line of its output.
    /// Throws UsageError if it is not installed, DataError with its last lines if it fails, Interrupted if the user
    /// stopped it.
    void run(const std::string& name, const std::vector<std::string>& arguments,
             const std::function<void(const std::string&)>& on_line);

    const std::filesystem::path& path() const { return path_; }
    /// Returns whether any program was started.
    bool has_runs() const { return has_runs_; }

  private:
    std::filesystem::path path_;
    std::ofstream file_;
    bool has_runs_ = false;
};

/// Capabilities and options of the installed `colmap`.
class ColmapProgram {
  public:
    /// Throws UsageError if colmap is not installed.
    ColmapProgram();

    const std::string& version() const { return version_; }  ///< "COLMAP 3.8"
    bool has_cuda() const { return has_cuda_; }
    /// Returns the output of `colmap command -h`.
    const std::string& help(const std::string& command);
    /// Returns the option of `command` with this name after the dot: for "use_gpu" of feature_extractor
    /// "--SiftExtraction.use_gpu" or, in later versions, "--FeatureExtraction.use_gpu". Returns an empty string if
    /// there is none.
    std::string option(const std::string& command, const std::string& name);

  private:
    std::string version_;
    bool has_cuda_ = false;
    std::map<std::string, std::string> helps_;
};

/// Progress of a stage.
struct StageCount {
    std::int64_t done = 0, total = 0;  ///< a total of 0 means unknown
};

/// Parses "[3/67]", and "[2/3, 1/3]" (blocks of pairs) as 4 of 9. Returns nothing if the line holds no such count.
std::optional<StageCount> count_in(const std::string& line);

/// Parses the number of registered photographs from "Registering image #7 (5)", in later versions "(num_reg_frames=5)".
/// Returns nothing for other lines.
std::optional<StageCount> registered_in(const std::string& line);

/// Parses the error in pixels from "Mean reprojection error: 0.479041px". Returns nothing for other lines.
std::optional<double> reprojection_error_in(const std::string& line);

}  // namespace gs
