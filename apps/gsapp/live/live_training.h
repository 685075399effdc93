// SPDX-License-Identifier: Apache-2.0
// A training that can be watched in a browser, with a limit on the time that watching costs.
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

/// Limits how often work that interrupts the training is done, so that it takes only a small share of the time.
class Throttle {
  public:
    static constexpr double kMostShare = 0.03;    ///< share of the time between two starts of work
    static constexpr double kLeastSeconds = 2.0;  ///< least time between two pieces of work

    bool due(double now) const { return now >= next_; }
    /// Records work that started at `start` and took `seconds`.
    void spent(double start, double seconds) { next_ = start + std::max(kLeastSeconds, seconds / kMostShare); }

  private:
    double next_ = 0;
};

/// Serves the page of one training. If nobody is watching, it costs the training only a check of the clock; otherwise
/// its cost is limited by Throttle. It reads the model only if reading has no side effects
/// (TrainProgress::rows_current), so watching does not change the result of a run.
class LiveTraining {
  public:
    /// `options` and `scene` must outlive the object. Throws the errors of LivePage.
    LiveTraining(const TrainOptions& options, const Scene& scene, std::optional<int> port);
    /// Waits for a watching page to receive the last status, a few seconds at most.
    ~LiveTraining();

    std::string address() const { return page_.address(); }

    /// Does the work due between two iterations: status, snapshot, and requests from the buttons. Waits while the
    /// training is paused. Returns the request for the trainer.
    WatcherRequest between(const TrainProgress& progress, Backend& backend);
    /// Reports that the requested checkpoint was saved, or why it could not be.
    void saved(std::int64_t iteration, const std::string& error);
    /// Shows the finished model.
    void finish(std::int64_t iteration, Backend& backend);
    /// Reports how the training ended, if it did not finish.
    void end(const std::string& state, const std::string& message) {
        ended_ = true;
        page_.tell({{"state", state}, {"message", message}});
    }

  private:
    void tell(const char* state, const TrainProgress& progress);
    bool is_packing() const;
    /// Takes a snapshot. Errors are reported on the page and do not end the training.
    void take_snapshot(std::int64_t iteration, Backend& backend, bool measured);
    void begin_snapshot(std::int64_t iteration, Backend& backend, bool measured);
    void measure(std::int64_t iteration, Backend& backend);

    const TrainOptions& options_;
    const Scene& scene_;
    const std::vector<View> views_;
    LivePage page_;
    Throttle throttle_;
    bool ended_ = false;
    double told_ = 0;                  ///< time of the last call of `tell`
    double rate_ = 0;                  ///< iterations per second of training; 0: not known
    std::int64_t rate_iteration_ = 0;  ///< iteration at which the rate was last computed
    double rate_seconds_ = -1;
    std::optional<std::vector<Photograph>> photographs_;  ///< read when the page is first watched
    std::optional<WorkFolder> folder_;                    ///< folder of snapshots
    std::filesystem::path last_;                          ///< last snapshot
    int num_snapshots_ = 0;
    double started_ = 0;           ///< start time of the last snapshot
    double device_seconds_ = 0;    ///< training time it cost before packing
    std::future<double> packing_;  ///< packing time of the snapshot
};

}  // namespace gs
