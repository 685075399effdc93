// SPDX-License-Identifier: Apache-2.0
// Writes stats/train.jsonl: one JSON object per line, readable while the run goes on.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

namespace gs {

class TrainLog {
  public:
    /// Keeps the lines up to `iteration` that an earlier part of the run wrote, and appends after them. `at_end`: the
    /// run has all its iterations and only ends once more, so "final" lines of `iteration` are left out. Throws
    /// DataError.
    TrainLog(const std::filesystem::path& path, std::int64_t iteration, bool at_end);
    ~TrainLog();
    TrainLog(const TrainLog&) = delete;
    TrainLog& operator=(const TrainLog&) = delete;

    /// Writes one line, which must have "iteration". A line that cannot be written is kept and tried again with the
    /// next one; a warning says so once.
    void write(const nlohmann::json& line);

    /// Returns the "reason" of the "photometric" event among the lines that were kept; empty if there is none.
    const std::string& photometric_reason() const { return photometric_reason_; }
    /// Writes what is left, to the disk (fsync). Throws DataError when a line could not be written in the end.
    void close();

  private:
    int flush();

    std::filesystem::path path_;
    int fd_ = -1;
    std::string waiting_;  ///< lines, the first perhaps without its beginning, that are not yet in the file
    bool warned_ = false;
    std::string photometric_reason_;
};

}  // namespace gs
