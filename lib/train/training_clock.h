// SPDX-License-Identifier: Apache-2.0
// Measures the time of a training, including all its parts if it was resumed.
#pragma once

#include <optional>

#include "kernels/base/clock.h"
#include "lib/model/checkpoint.h"
#include "lib/train/training_schedule.h"
#include "lib/train/training_views.h"

namespace gs {

/// Measures the times of TrainingTime. A resumed run calls resume() first.
class TrainingClock {
  public:
    /// `schedule` counts the time under a limit, and `views` the time that steps waited for images. Both must outlive
    /// the object.
    TrainingClock(TrainingSchedule& schedule, const TrainingViews& views) : schedule_(schedule), views_(views) {}

    /// Adds the times of the earlier parts of the run; empty: unknown.
    void resume(const std::optional<TrainingTime>& earlier) {
        earlier_ = earlier;
        if (earlier) train_seconds_ = earlier->train_seconds;
    }

    /// Runs `fn` and counts its time as training time.
    template <class Fn> void count(Fn&& fn) {
        const double start = seconds_now();
        fn();
        train_seconds_ += seconds_now() - start;
    }
    /// Runs `fn` and excludes its time from a time limit.
    template <class Fn> void leave_out(Fn&& fn) {
        const double start = seconds_now();
        fn();
        schedule_.leave_out(seconds_now() - start);
    }

    /// Returns the training time in seconds, including earlier parts of the run if their times are known.
    double train_seconds() const { return train_seconds_; }
    /// Returns the part of train_seconds() spent waiting for images.
    double data_wait_seconds() const { return views_.wait_seconds() + (earlier_ ? earlier_->data_wait_seconds : 0); }
    /// Returns whether the times of all parts of the run are known.
    bool knows_all() const { return earlier_.has_value(); }
    /// Returns the times so far; nothing if the times of an earlier part are unknown.
    std::optional<TrainingTime> time() const {
        if (!earlier_) return std::nullopt;
        return TrainingTime{.train_seconds = train_seconds_,
                            .data_wait_seconds = data_wait_seconds(),
                            .limited_seconds = schedule_.used_seconds()};
    }

  private:
    TrainingSchedule& schedule_;
    const TrainingViews& views_;
    std::optional<TrainingTime> earlier_ = TrainingTime{};  ///< times of the parts before a resume; empty = unknown
    double train_seconds_ = 0;
};

}  // namespace gs
