// SPDX-License-Identifier: Apache-2.0
// Writes stats/train.jsonl: one JSON object per line, readable while the run goes on.
#pragma once

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

namespace gs {

class TrainLog {
  public:
    /// Keeps the lines up to `iteration` that an earlier part of the run wrote, and appends after them. Throws
    /// DataError.
    TrainLog(const std::filesystem::path& path, std::int64_t iteration);

    /// Writes one line, which must have "iteration". Throws DataError when the write fails.
    void write(const nlohmann::json& line);

    /// Returns the "reason" of the "photometric" event among the lines that were kept; empty if there is none.
    const std::string& photometric_reason() const { return photometric_reason_; }

  private:
    std::filesystem::path path_;
    std::ofstream out_;
    std::string photometric_reason_;
};

}  // namespace gs
