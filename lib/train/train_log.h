// SPDX-License-Identifier: Apache-2.0
// stats/train.jsonl: one JSON object per line, readable while the run goes on.
#pragma once

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

namespace gs {

class TrainLog {
  public:
    /// Keeps the lines up to `iteration` that an earlier part of the run wrote, and appends from there. Throws DataError.
    TrainLog(const std::filesystem::path& path, std::int64_t iteration);

    /// Every line has "iteration". Throws DataError when the disk refuses.
    void write(const nlohmann::json& line);

  private:
    std::filesystem::path path_;
    std::ofstream out_;
};

}  // namespace gs
