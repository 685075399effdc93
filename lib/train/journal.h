// SPDX-License-Identifier: Apache-2.0
// Records the events of a training in stats/train.jsonl, in TensorBoard, and as log messages.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "kernels/requests.h"
#include "lib/model/run_folder.h"
#include "lib/train/densification.h"
#include "lib/train/residual_share.h"
#include "lib/train/target_search.h"
#include "lib/train/train_hooks.h"
#include "lib/train/train_log.h"

namespace gs {

/// The state of a training after some steps, as one line of the log.
struct StepLine {
    StepStats stats;
    std::int64_t num_gaussians = 0;
    int active_degree = 0;
    double seconds = 0;            ///< seconds since the previous line
    double data_wait_seconds = 0;  ///< waiting time of steps for images since the run began or was resumed
    double train_seconds = 0;      ///< training time of the whole run
    StepRates rates;               ///< learning rates of the last step
};

/// Writes one line for each event of a training. Call open() or resume() first, begin_final_lines() after the last
/// checkpoint, and close() after the last line. All functions that write throw DataError once the run folder is gone.
class Journal {
  public:
    /// `lock` and `tensorboard` may be null; the latter must outlive the object.
    Journal(RunFolder folder, std::shared_ptr<const RunLock> lock, TensorBoard* tensorboard)
        : folder_(std::move(folder)), lock_(std::move(lock)), tensorboard_(tensorboard) {}

    /// Begins the log of a new run.
    void open();
    /// Continues the log after `iteration`; `at_end` as for TrainLog.
    void resume(std::int64_t iteration, bool at_end);
    /// Marks all further lines as "final". They come after the last checkpoint, so a run resumed from it writes them
    /// again.
    void begin_final_lines() { lines_are_final_ = true; }
    /// Ends the log. Throws DataError if lines could not be written to the file.
    void close() { log_->close(); }

    // Events. `iteration`, from 1, is the step to which an event belongs, or the last step before it.
    /// Writes any event. `line` must have "event" and "iteration".
    void write(nlohmann::json line);
    void write_step(const StepLine& line, std::int64_t iteration);
    /// Writes a change of the set of Gaussians; no line if nothing changed.
    void write_change(const ScheduledChange& change, std::int64_t iteration);
    void write_residuals(const ResidualChange& change, std::int64_t num_gaussians, std::int64_t iteration);
    /// Writes that Gaussians were removed for parameters that were not finite or out of range. `parameters` is their
    /// count by group, in words.
    void write_nonfinite(std::int64_t removed, const std::string& parameters, std::int64_t iteration);
    void write_evaluation(const TestScores& scores, std::int64_t iteration);
    void write_target(const MeasuredModel& measured);

    /// Returns TrainLog::reason of an event, also from before a resume.
    std::string reason(const std::string& event) const { return log_->reason(event); }

  private:
    void check_folder() const {
        if (lock_) lock_->check_folder();
    }

    const RunFolder folder_;
    const std::shared_ptr<const RunLock> lock_;
    TensorBoard* const tensorboard_;
    std::optional<TrainLog> log_;
    bool lines_are_final_ = false;
    double earlier_wait_ = 0;  ///< StepLine::data_wait_seconds of the previous line
};

}  // namespace gs
