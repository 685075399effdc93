// SPDX-License-Identifier: Apache-2.0
// Writes the course of a training to stats/train.jsonl and to TensorBoard's event file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "kernels/requests.h"
#include "lib/io/event_file.h"

namespace gs {

/// Writes stats/train.jsonl: one JSON object per line, readable during the run. Call close() after the last line.
class TrainLog {
  public:
    /// Keeps the lines up to `iteration` from before a resume, and appends after them. `at_end`: the run has finished
    /// all its iterations and only repeats its end, so "final" lines of `iteration` are dropped. Throws DataError.
    TrainLog(const std::filesystem::path& path, std::int64_t iteration, bool at_end);
    ~TrainLog();
    TrainLog(const TrainLog&) = delete;
    TrainLog& operator=(const TrainLog&) = delete;

    /// Writes one line, which must have "iteration". A line that cannot be written is kept and retried with the next
    /// line; a warning is logged once.
    void write(const nlohmann::json& line);

    /// Returns the "reason" of the last event of a kind, which is a decision with its measured value; empty if there is
    /// none.
    std::string reason(const std::string& event) const {
        const auto found = reasons_.find(event);
        return found == reasons_.end() ? std::string() : found->second;
    }
    /// Writes the pending lines to the disk (fsync). Throws DataError if a line still cannot be written.
    void close();

  private:
    int flush();
    void keep_reason(const nlohmann::json& line);

    std::filesystem::path path_;
    int fd_ = -1;
    std::string waiting_;  ///< lines not yet in the file; the beginning of the first may already be written
    bool warned_ = false;
    std::map<std::string, std::string> reasons_;
};

/// The event file of one run, or of the part of a run after a resume. A failed write is logged as a warning once, and
/// the training goes on.
class TensorBoard {
  public:
    /// Throws DataError if no event file can be created in `folder`.
    explicit TensorBoard(const std::filesystem::path& folder) : file_(folder) {}

    /// Continues a run after `iteration`: the events of later iterations in an earlier file no longer count.
    void resume(std::int64_t iteration);
    /// Adds the numbers of a line of stats/train.jsonl that TensorBoard shows, if any.
    void add_line(const nlohmann::json& line);
    /// Adds the learning rates of a step; for a residual with several rates the highest.
    void add_rates(std::int64_t iteration, const StepRates& rates);
    void add_picture(std::int64_t iteration, const std::string& tag, const Image& picture);

  private:
    void attempt(const std::function<void()>& write);

    EventFile file_;
    bool warned_ = false;
};

}  // namespace gs
