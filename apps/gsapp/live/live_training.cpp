// SPDX-License-Identifier: Apache-2.0
// Updates the page of a training between its iterations.
#include "apps/gsapp/live/live_training.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <exception>
#include <system_error>
#include <thread>

#include "appearance/model_info.h"
#include "eval/runs/shown_views.h"
#include "kernels/base/clock.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/model/run_folder.h"
#include "lib/scene/resized.h"
#include "lib/scene/scene.h"

namespace gs {
namespace {

constexpr std::size_t kMeasuredViews = 4;
constexpr double kTellSeconds = 0.25;  ///< least time between two status updates
constexpr double kRateSeconds = 1;     ///< training time over which the rate is measured
constexpr double kLingerSeconds = 5;

LivePageFacts facts_of(const TrainOptions& options, const std::vector<View>& views) {
    return {.scene = scene_name(options.source),
            .appearance = options.appearance,
            .run = options.model,
            .log = RunFolder{options.model}.train_log(),
            .views = without_lenses(views),
            .background = options.background.color,
            .controls = true};
}

}  // namespace

LiveTraining::LiveTraining(const TrainOptions& options, const Scene& scene, std::optional<int> port)
    : options_(options), scene_(scene), views_(shown_views(scene)), page_(facts_of(options, views_), port) {
    page_.tell({{"state", "starting"}});
    if (!options.time_limit) page_.tell({{"iterations", options.iterations}});
}

LiveTraining::~LiveTraining() {
    if (!ended_ && std::uncaught_exceptions() > 0) end("failed", "the program says why");
    if (packing_.valid()) packing_.wait();
    page_.linger(kLingerSeconds);
}

bool LiveTraining::is_packing() const {
    return packing_.valid() && packing_.wait_for(std::chrono::seconds(0)) != std::future_status::ready;
}

void LiveTraining::tell(const char* state, const TrainProgress& now) {
    if (rate_seconds_ < 0 || now.iteration < rate_iteration_) {
        rate_iteration_ = now.iteration, rate_seconds_ = now.train_seconds;
    } else if (const double seconds = now.train_seconds - rate_seconds_; seconds >= kRateSeconds) {
        rate_ = double(now.iteration - rate_iteration_) / seconds;
        rate_iteration_ = now.iteration, rate_seconds_ = now.train_seconds;
    }
    nlohmann::ordered_json news = {{"state", state},
                                   {"appearance", options_.appearance},
                                   {"iteration", now.iteration},
                                   {"num_gaussians", now.num_gaussians},
                                   {"train_seconds", now.train_seconds}};
    news["loss"] =
        now.iteration > 0 && std::isfinite(now.loss) ? nlohmann::ordered_json(now.loss) : nlohmann::ordered_json();
    if (now.expected_iterations > 0) news["iterations"] = now.expected_iterations;
    if (rate_ > 0) news["iterations_per_second"] = rate_;
    if (now.seconds_left)
        news["eta_seconds"] = *now.seconds_left;
    else if (rate_ > 0)
        news["eta_seconds"] = double(now.expected_iterations - now.iteration) / rate_;
    page_.tell(news);
}

void LiveTraining::measure(std::int64_t iteration, Backend& backend) {
    if (!photographs_) {
        photographs_.emplace();
        try {
            photographs_ = load_photographs(shown_views(scene_, kMeasuredViews), options_.background.color);
        } catch (const std::exception& e) {  // the training itself reports images that have become unreadable
            log_warning("the page shows no PSNR: {}", e.what());
        }
    }
    if (photographs_->empty()) return;
    const double psnr = mean_psnr(backend, *photographs_, options_.background.color, backend.download_ppisp().active());
    page_.add_psnr(iteration, psnr,
                   fmt::format("{} {} views", photographs_->size(), scene_.test.empty() ? "training" : "test"));
}

void LiveTraining::take_snapshot(std::int64_t iteration, Backend& backend, bool measured) {
    started_ = seconds_now();
    try {
        begin_snapshot(iteration, backend, measured);
    } catch (const std::exception& e) {
        page_.tell({{"snapshot_error", e.what()}});
        throttle_.spent(started_, seconds_now() - started_);
    }
}

void LiveTraining::begin_snapshot(std::int64_t iteration, Backend& backend, bool measured) {
    if (!folder_) folder_.emplace(std::filesystem::path(options_.model) / "live");
    if (measured) measure(iteration, backend);
    const std::filesystem::path file = folder_->path() / fmt::format("{}.ngsplat", ++num_snapshots_);
    auto work = [this, file, iteration, model = backend.download(false)] {
        const double start = seconds_now();
        try {
            write_snapshot(file, model,
                           {scene_name(options_.source), iteration, options_.background.color, scene_.frame, views_,
                            scene_.test.empty()});
            page_.show(file, iteration);
            page_.tell({{"snapshot_error", nullptr}});
            std::error_code ignored;  // a file being sent stays open
            if (!last_.empty()) std::filesystem::remove(last_, ignored);
            last_ = file;
        } catch (const std::exception& e) {
            page_.tell({{"snapshot_error", e.what()}});
        }
        return seconds_now() - start;
    };
    device_seconds_ = seconds_now() - started_;
    packing_ = std::async(std::launch::async, std::move(work));
}

WatcherRequest LiveTraining::between(const TrainProgress& progress, Backend& backend) {
    if (packing_.valid() && !is_packing()) throttle_.spent(started_, device_seconds_ + packing_.get());
    const WatcherRequests requests = page_.requests();
    if (requests.stop) return WatcherRequest::kStop;
    if (page_.watched()) {
        const double now = seconds_now();
        if (now - told_ >= kTellSeconds) {
            tell("training", progress);
            told_ = now;
        }
        if (progress.rows_current && !packing_.valid() && throttle_.due(now))
            take_snapshot(progress.iteration, backend, progress.iteration > 0);
    }
    if (requests.pause) {
        tell("paused", progress);
        while (page_.requests().pause && !page_.requests().stop && !interrupted())
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        told_ = 0;
        if (page_.requests().stop) return WatcherRequest::kStop;
        tell("training", progress);
    }
    return page_.requests().save && progress.rows_current ? WatcherRequest::kSave : WatcherRequest::kNone;
}

void LiveTraining::saved(std::int64_t iteration, const std::string& error) {
    page_.saved();
    page_.tell({{"save_error", error}});
    if (error.empty()) page_.tell({{"saved_iteration", iteration}});
}

void LiveTraining::finish(std::int64_t iteration, Backend& backend) {
    if (packing_.valid()) packing_.wait();
    ended_ = true;
    page_.tell({{"state", "finished"}, {"iteration", iteration}, {"num_gaussians", backend.count()}});
    if (page_.watched()) take_snapshot(iteration, backend, true);
}

}  // namespace gs
