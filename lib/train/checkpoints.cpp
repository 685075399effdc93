// SPDX-License-Identifier: Apache-2.0
// Writes checkpoints, and describes how a run continues from them.
#include "lib/train/checkpoints.h"

#include <filesystem>
#include <utility>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "lib/core/log.h"
#include "lib/train/output_schedule.h"

namespace gs {

Checkpoints::Checkpoints(const OutputOptions& options, const TrainingSchedule& schedule, const TrainingClock& clock,
                         CameraRefinement& cameras, const RunWriter& writer)
    : options_(options),
      schedule_(schedule),
      clock_(clock),
      cameras_(cameras),
      writer_(writer),
      first_iteration_(schedule.iteration()),
      written_at_(clock.train_seconds()) {}

void Checkpoints::write(Backend& backend, bool automatic) {
    writer_.write_checkpoint({.state = kept_ ? *kept_ : backend.download(true),
                              .iteration = schedule_.iteration(),
                              .time = clock_.time(),
                              .cameras = cameras_.state(backend),
                              .automatic = automatic});
    written_at_ = clock_.train_seconds();
}

void Checkpoints::write(Backend& backend) { write(backend, false); }

void Checkpoints::write_by_time(Backend& backend) {
    const std::int64_t iteration = schedule_.iteration();
    if (!options_.checkpoint_minutes || iteration % kLogInterval != 0 || schedule_.finished() ||
        clock_.train_seconds() - written_at_ < 60 * *options_.checkpoint_minutes ||
        lists(options_.checkpoint_iterations, iteration))
        return;
    written_at_ = clock_.train_seconds();  // also after a failure, so that the next attempt waits as long
    writer_.check_folder();
    const double start = seconds_now();
    try {
        write(backend, true);
    } catch (const DataError& e) {
        log_warning("iteration {}: no checkpoint was written: {}", iteration, e.what());
        return;
    }
    if (std::exchange(cost_is_told_, true)) return;
    std::error_code ignored;
    const auto bytes = std::filesystem::file_size(writer_.folder().checkpoint(iteration), ignored);
    log_info(
        "iteration {}: checkpoint of {:.1f} MiB written in {:.2f} s; from now on one every {:g} minutes "
        "(--checkpoint-minutes), of which the latest is kept",
        iteration, double(bytes) / (1024.0 * 1024.0), seconds_now() - start, *options_.checkpoint_minutes);
}

std::string Checkpoints::write_with_points(Backend& backend) {
    const std::int64_t iteration = schedule_.iteration();
    writer_.check_folder();
    try {
        writer_.write_point_cloud(backend, iteration);
        write(backend);
    } catch (const DataError& e) {
        log_warning("iteration {}: nothing was saved: {}", iteration, e.what());
        return e.what();
    }
    log_info("iteration {}: checkpoint and point cloud saved", iteration);
    return "";
}

std::string Checkpoints::rescue(Backend& backend) {
    if (schedule_.iteration() == first_iteration_) return "";
    try {
        backend.synchronize();  // abandons steps that do not fit into memory
    } catch (const std::exception&) {
    }
    try {
        write(backend);
    } catch (const std::exception& e) {  // the original error is the one to report
        log_warning("no checkpoint could be written: {}", e.what());
        return latest();
    }
    return ", checkpoint written to " + writer_.folder().checkpoint(schedule_.iteration()).string() + "; " +
           how_to_continue();
}

/// Returns the text of a message about the latest checkpoint; empty if there is none.
std::string Checkpoints::latest() const {
    try {
        return "; the last checkpoint is " + latest_checkpoint(writer_.folder().root).string() + "; " +
               how_to_continue();
    } catch (const Error&) {
        return "";
    }
}

std::string Checkpoints::how_to_continue() const {
    return "continue with --resume latest -m " + writer_.folder().root.string();
}

}  // namespace gs
