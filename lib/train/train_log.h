// SPDX-License-Identifier: Apache-2.0
// Writes the course of a training: stats/train.jsonl, one JSON object per line, readable while the run goes on, and
// what TensorBoard shows.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

#include "kernels/requests.h"
#include "lib/io/event_file.h"

namespace gs {

/// Writes stats/train.jsonl: one JSON object per line, readable while the run goes on. close() follows the last line.
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
    /// Writes the lines that wait, to the disk (fsync). Throws DataError when a line could not be written in the end.
    void close();

  private:
    int flush();

    std::filesystem::path path_;
    int fd_ = -1;
    std::string waiting_;  ///< lines, the first perhaps without its beginning, that are not yet in the file
    bool warned_ = false;
    std::string photometric_reason_;
};

/// The event file of one run, or of the part of it that follows a resume. A failure to write later on is a warning,
/// once: the training goes on.
class TensorBoard {
  public:
    /// Throws DataError if there can be no event file in `folder`.
    explicit TensorBoard(const std::filesystem::path& folder) : file_(folder) {}

    /// Continues a run after `iteration`: the events of later iterations in an earlier file no longer count.
    void resume(std::int64_t iteration);
    /// Takes the numbers of a line of stats/train.jsonl, if it has any to show.
    void add_line(const nlohmann::json& line);
    /// Adds the learning rates of a step; of a residual with several the highest.
    void add_rates(std::int64_t iteration, const StepRates& rates);
    void add_picture(std::int64_t iteration, const std::string& tag, const Image& picture);

  private:
    void attempt(const std::function<void()>& write);

    EventFile file_;
    bool warned_ = false;
};

}  // namespace gs
