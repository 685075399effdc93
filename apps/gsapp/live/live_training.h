// SPDX-License-Identifier: Apache-2.0
// A training that can be watched while it goes on, and how often it stops for those who watch it.
#pragma once

#include <algorithm>
#include <future>
#include <memory>
#include <optional>

#include "apps/gsapp/live/live_page.h"
#include "eval/auto/photograph.h"
#include "lib/core/train_options.h"
#include "lib/io/temporary.h"
#include "lib/train/trainer.h"

namespace gs {

/// Spaces out work that costs the training time, so that it takes at most a small share of it.
class Throttle {
  public:
    static constexpr double kMostShare = 0.03;    ///< of the time from the beginning of one piece of work to the next
    static constexpr double kLeastSeconds = 2.0;  ///< between two pieces

    bool due(double now) const { return now >= next_; }
    /// Says that work was begun at `start` and cost `seconds`.
    void spent(double start, double seconds) { next_ = start + std::max(kLeastSeconds, seconds / kMostShare); }

  private:
    double next_ = 0;
};

/// Serves the page of one training. While nobody looks it costs the training nothing but a look at a clock; what it
/// costs else is bounded by Throttle. It reads the model only if that changes nothing (TrainProgress::rows_current),
/// so a run that was watched is the same as one that was not.
class LiveTraining {
  public:
    /// `options` and `scene` must outlive the object. Throws what LivePage throws.
    LiveTraining(const TrainOptions& options, const Scene& scene, std::optional<int> port);
    /// Waits for a page that is watching to take the last news, a few seconds at most.
    ~LiveTraining();

    std::string address() const { return page_.address(); }

    /// Does what is due between two iterations: news, a snapshot, what the buttons asked for. Waits while the training
    /// is paused. Returns what the trainer is to do.
    WatcherRequest between(const TrainProgress& progress, Backend& backend);
    /// Says that what was asked for is saved, or why it could not be.
    void saved(std::int64_t iteration, const std::string& error);
    /// Shows the finished model.
    void finish(std::int64_t iteration, Backend& backend);
    /// Says how the training ended, if it did not finish.
    void end(const std::string& state, const std::string& message) {
        ended_ = true;
        page_.tell({{"state", state}, {"message", message}});
    }

  private:
    void tell(const char* state, const TrainProgress& progress);
    bool is_packing() const;
    /// What fails here is told to the page; it is no reason to end a training.
    void take_snapshot(std::int64_t iteration, Backend& backend, bool measured);
    void begin_snapshot(std::int64_t iteration, Backend& backend, bool measured);
    void measure(std::int64_t iteration, Backend& backend);

    const TrainOptions& options_;
    const Scene& scene_;
    const std::vector<View> views_;
    LivePage page_;
    Throttle throttle_;
    bool ended_ = false;
    double told_ = 0;                  ///< when `tell` last did
    double rate_ = 0;                  ///< iterations per second of training; 0: not known
    std::int64_t rate_iteration_ = 0;  ///< where the rate was last computed
    double rate_seconds_ = -1;
    std::optional<std::vector<Photograph>> photographs_;  ///< read when somebody looks for the first time
    std::optional<WorkFolder> folder_;                    ///< of snapshots
    std::filesystem::path last_;                          ///< snapshot
    int num_snapshots_ = 0;
    double started_ = 0;           ///< when the last snapshot was begun
    double device_seconds_ = 0;    ///< what it cost the training before it was packed
    std::future<double> packing_;  ///< its result is the time that packing took
};

}  // namespace gs
