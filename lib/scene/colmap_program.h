// SPDX-License-Identifier: Apache-2.0
// What the installed `colmap` can do, and what its messages say. Options were renamed between 3.8 and 4.x, so its own
// help is asked rather than its version.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace gs {

class ColmapProgram {
  public:
    /// Throws UsageError when colmap is not installed.
    ColmapProgram();

    const std::string& version() const { return version_; }  ///< "COLMAP 3.8"
    bool has_cuda() const { return has_cuda_; }
    /// Returns what `colmap command -h` prints.
    const std::string& help(const std::string& command);
    /// Returns the option of `command` whose name after the dot this is: for "use_gpu" of feature_extractor
    /// "--SiftExtraction.use_gpu" or, later, "--FeatureExtraction.use_gpu". Empty where there is none.
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
