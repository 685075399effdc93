// SPDX-License-Identifier: Apache-2.0
// The loop of a run: iterations, what is due between them, and the end.
#include "lib/train/trainer.h"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <new>
#include <optional>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/core/quantities.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/initialize.h"
#include "lib/scene/camera_params.h"
#include "lib/train/choose_backend.h"
#include "lib/train/densification.h"
#include "lib/train/model_limits.h"
#include "lib/train/photometric.h"
#include "lib/train/residual_share.h"
#include "lib/train/run_costs.h"
#include "lib/train/run_writer.h"
#include "lib/train/step_composer.h"
#include "lib/train/target_search.h"
#include "lib/train/training_schedule.h"
#include "lib/train/training_views.h"

namespace gs {
namespace {

/// A loss that is not finite this often in a row does not recover. Also the iterations between two looks at the
/// statistics: a device may be behind, and asking it each time would make it wait.
constexpr std::int64_t kMaxSkips = 10;
/// The points that a training begins with at least, however short it is.
constexpr std::int64_t kLeastPoints = 1000;
/// How many times as long as rendering a view a look at what its residuals are worth takes.
constexpr double kWorthPerFrame = 4;
/// The seconds of a time limit that finishing and writing the controllers may take.
constexpr double kControllerEnd = 0.05;

/// The seconds of steps from which the time of a training is estimated, and the estimate from which on it is said.
constexpr double kMeasuredSeconds = 3, kLongTraining = 3600;

/// The seconds between two automatic checkpoints; infinite without them.
double automatic_interval(const OutputOptions& options) {
    return options.checkpoint_minutes ? 60 * *options.checkpoint_minutes : std::numeric_limits<double>::infinity();
}

bool contains(const std::vector<std::int64_t>& list, std::int64_t value) {
    return std::find(list.begin(), list.end(), value) != list.end();
}

/// Says what the steps of several ranks cost.
void log_exchanges(const RankCosts& costs) {
    constexpr double kMegabyte = 1e6;
    if (costs.steps == 0 || costs.traffic.sent == 0) return;
    log_info("ranks: rank 0 sent {:.2f} MB in a step and spent {:.0f} % of it in exchanges, waiting included",
             costs.traffic.sent / double(costs.steps) / kMegabyte, 100 * costs.traffic.seconds / costs.seconds);
}

class Run {
  public:
    Run(const TrainOptions& options, const Scene& scene, RunStart start, Progress& progress, const TrainHooks& hooks)
        : output_(options),
          length_(options),
          device_(options.device),
          densification_options_(options),
          controller_limit_(options.controller_iterations),
          scene_(scene),
          progress_(progress),
          hooks_(hooks),
          appearance_(appearance_spec(options)),
          views_(options, scene),
          limits_(options, scene, views_.fixed_background(), hooks.most_gaussians),
          schedule_(options, scene.train.size()),
          search_(options.target_psnr.value_or(0), std::int64_t(scene.train.size()), options.iterations, limits_.cap()),
          densification_(options, appearance_, scene.extent, options.background.always(0, 0, 0), limits_.views()),
          photometric_(options, scene),
          composer_(options, appearance_, scene, &photometric_),
          residuals_(options, appearance_, scene),
          writer_(std::move(start.folder), std::move(start.lock), std::move(start.cameras), options, scene,
                  photometric_, hooks.tensorboard) {
        set_num_threads(options.threads);
        composer_.rates().log(options);
        if (start.checkpoint)
            resume(options, std::move(*start.checkpoint));
        else
            begin(options, start.used_seconds, std::move(start.initial));
        log_memory_plan(options, scene_, appearance_, backend_->count());
        writer_.open_log(iteration_, schedule_.finished());
        if (hooks_.tensorboard && start.checkpoint) hooks_.tensorboard->resume(iteration_);
        photometric_decision_ = writer_.opened_log().photometric_reason();  // of an earlier part of the run
        if (!start.first_event.is_null()) {
            start.first_event["iteration"] = 0;
            writer_.log(start.first_event);
        }
        prune_nonfinite();  // before such a Gaussian leaves its mark in the moments of all that it covers
    }

    TrainSummary run() {
        if (schedule_.limits_time()) begin_time();
        progress_.start(schedule_.expected_iterations(), iteration_);
        expect_end();
        views_.prefetch(iteration_, last_iteration(), schedule_.reduction());
        const std::int64_t first = iteration_;
        try {
            if (length_.target_psnr)
                search();
            else
                loop();
        } catch (const DeviceError& e) {
            throw DeviceError(e.what() + rescue(first));
        } catch (const std::bad_alloc&) {
            throw DeviceError("out of memory; lower --cap-max, --resolution or --image-cache" + rescue(first));
        } catch (const DataError& e) {  // an image that has gone bad, or a file that cannot be written
            throw DataError(e.what() + rescue(first));
        }
        try {
            return finish();
        } catch (const DataError& e) {
            std::error_code ignored;
            if (!std::filesystem::exists(writer_.folder().checkpoint(iteration_), ignored))
                throw DataError(e.what() + rescue(first));
            throw DataError(e.what() + ("; the training itself is saved, " + how_to_continue()));
        }
    }

  private:
    /// Returns the end of the iterations for which images are decoded ahead.
    std::int64_t last_iteration() const {
        return length_.ends_by_iterations() ? length_.iterations : std::numeric_limits<std::int64_t>::max();
    }

    /// Writes what a resumed run continues with: in the search for a target the smallest model that reached it, since a
    /// smaller one that is still recovering would seem to be below.
    void write_checkpoint(bool automatic = false) {
        writer_.write_checkpoint(kept_ ? *kept_ : backend_->download(true), iteration_, time(), automatic);
    }

    /// Measures what a time limit has to account for, and starts its clock.
    void begin_time() {
        const std::int64_t count = backend_->count();
        TimeCosts costs{.saving_per_gaussian = writer_.seconds_per_gaussian(*backend_)};
        costs.at_end = limits_.seconds_to_prune(*backend_);
        if (const std::size_t views = residuals_.views_at_end(); views > 0)
            costs.at_end += kWorthPerFrame * double(views) * limits_.view_seconds(*backend_);
        if (length_.target_psnr) {
            const double start = seconds_now();
            hooks_.held_out_psnr(*backend_);
            costs.at_end += seconds_now() - start;
        }
        if (schedule_.reduction() > 1)
            costs.coarse_ratio =
                std::max(1.0, limits_.view_seconds(*backend_) / limits_.view_seconds(*backend_, schedule_.reduction()));
        schedule_.start(costs, count);
        keep_time_for_controllers();
        if (schedule_.finished())
            log_warning("time limit {}: it is used up: nothing is trained", length_.time_limit->text());
        log_debug(
            "time limit {}: saving takes about {:.2f} s for {} Gaussians; growth ends when fewer than {} steps would "
            "remain",
            length_.time_limit->text(), costs.saving_per_gaussian * double(count), count, schedule_.wanted_steps());
    }

    /// Trains segment after segment until the search for options.target_psnr ends.
    void search() {
        if (const ScheduleSegment first = search_.first(iteration_, backend_->count()); first.steps > 0) {
            schedule_.begin(first, backend_->count());
            loop();
        }
        while (true) {
            const TargetStep step = search_.next(measure());
            if (step.keep) kept_ = backend_->download(true);
            if (step.restore) backend_->upload(*kept_);
            if (step.segment.steps == 0) break;
            schedule_.begin(step.segment, backend_->count());
            if (schedule_.finished()) {
                search_.stop("the time limit ends");
                break;
            }
            if (step.prune_to > 0) timed([&] { limits_.prune_to(*backend_, step.prune_to, "target"); });
            loop();
        }
        kept_.reset();
        progress_.finish();
        const TargetOutcome outcome = search_.outcome();
        if (outcome.reached)
            log_info("{}", outcome.verdict);
        else
            log_warning("{}", outcome.verdict);
    }

    /// Removes what is not written: Gaussians that cannot be seen or that a limit forbids, and residuals above the
    /// share.
    void remove_surplus() {
        backend_->prune_invisible();
        limits_.prune(*backend_);
        report_residuals(residuals_.at_end(*backend_, steps_on_views(schedule_.moment())), iteration_);
    }

    /// Measures the model as it would be written now.
    TargetSearch::Try measure() {
        timed([&] {
            settle();
            remove_surplus();
        });
        const HeldOutPsnr psnr = hooks_.held_out_psnr(*backend_);
        const TargetSearch::Try measured{iteration_, backend_->count(), psnr.mean, psnr.standard_error};
        log_info("iteration {}: {} Gaussians, {:.2f} dB on the held-out views", measured.steps, measured.count,
                 measured.psnr);
        writer_.log({{"event", "target"},
                     {"iteration", measured.steps},
                     {"num_gaussians", measured.count},
                     {"psnr", measured.psnr}});
        return measured;
    }

    void loop() {
        bool stop = watch() == WatcherRequest::kStop;
        double interval_start = seconds_now();
        const std::int64_t first_iteration = iteration_;
        const double first_seconds = train_seconds_;
        bool estimated = !length_.ends_by_iterations() || uses_cuda(device_);
        while (!schedule_.finished()) {
            timed([&] { iterate(); });
            if (!estimated && train_seconds_ - first_seconds >= kMeasuredSeconds) {
                estimated = true;
                warn_if_long(iteration_ - first_iteration, train_seconds_ - first_seconds);
            }
            const bool log = iteration_ % kLogInterval == 0 || schedule_.finished(), report = progress_.due(iteration_);
            stop = (stop || interrupted()) && !schedule_.finished();
            // What is reported or saved is the state after this iteration, and waiting for it is training time.
            if (log || report || stop || something_is_due()) timed([&] { settle(); });
            if (log) {
                write_log(seconds_now() - interval_start);
                interval_start = seconds_now();
            }
            if (report) {
                expect_end();
                progress_.update(iteration_, last_.loss, backend_->count());
            }
            save_what_is_due();
            const double watch_start = seconds_now();
            stop = (watch() == WatcherRequest::kStop || stop) && !schedule_.finished();
            interval_start += seconds_now() - watch_start;
            if (stop) {
                write_checkpoint();
                progress_.finish();
                throw Interrupted("interrupted after " + std::to_string(iteration_) + " iterations; " +
                                  how_to_continue());
            }
        }
    }

    /// Warns of a training that takes hours, as one with the defaults does on the CPU. The last `iterations` took
    /// `measured` seconds.
    void warn_if_long(std::int64_t iterations, double measured) const {
        double pixels = 0;
        for (const View& view : scene_.train) pixels += double(view.camera.width) * view.camera.height;
        const double seconds = estimate_seconds(length_, densification_options_,
                                                {.iteration = iteration_,
                                                 .seconds_per_iteration = measured / double(iterations),
                                                 .num_gaussians = backend_->count(),
                                                 .pixels = pixels / double(scene_.train.size())},
                                                limits_.cap());
        if (seconds < kLongTraining) return;
        log_warning(
            "this training takes about {} on the CPU, by the speed of its first {} iterations and the growth to come; "
            "--time-limit 10m, -r 4, or smaller --iterations and --cap-max shorten it",
            duration_text(seconds), iterations);
    }

    /// Tells the progress line when the training ends.
    void expect_end() {
        if (const std::optional<double> left = schedule_.seconds_left())
            progress_.expect_end_in(*left);
        else
            progress_.expect(schedule_.expected_iterations());
    }

    /// Shows the training to whoever watches it, and does what they ask for but the end.
    WatcherRequest watch() {
        const WatcherRequest request = ask(iteration_ % kLogInterval == 0);
        if (request == WatcherRequest::kSave) untimed([&] { hooks_.saved(iteration_, save_for_watcher()); });
        return request;
    }

    /// Shows the training to whoever watches it. Only where all rows are `current` may the model be read.
    WatcherRequest ask(bool current) {
        WatcherRequest request = WatcherRequest::kNone;
        if (!hooks_.between) return request;
        untimed([&] {
            request = hooks_.between({.iteration = iteration_,
                                      .num_gaussians = backend_->count(),
                                      .expected_iterations = schedule_.expected_iterations(),
                                      .seconds_left = schedule_.seconds_left(),
                                      .loss = last_.loss,
                                      .train_seconds = train_seconds_,
                                      .rows_current = current},
                                     *backend_);
        });
        return request;
    }

    /// Writes a checkpoint and the point cloud. That they cannot be written is no reason to end the run; returns it.
    std::string save_for_watcher() {
        writer_.check_folder();
        try {
            writer_.write_point_cloud(*backend_, iteration_);
            write_checkpoint();
        } catch (const DataError& e) {
            log_warning("iteration {}: nothing was saved: {}", iteration_, e.what());
            return e.what();
        }
        checkpoint_seconds_ = train_seconds_;
        log_info("iteration {}: checkpoint and point cloud saved", iteration_);
        return "";
    }

    /// Does what no limit counts.
    template <class Fn> void untimed(Fn&& fn) {
        const double start = seconds_now();
        fn();
        if (auto& budget = schedule_.budget()) budget->leave_out(seconds_now() - start);
    }

    template <class Fn> void timed(Fn&& fn) {
        const double start = seconds_now();
        fn();
        train_seconds_ += seconds_now() - start;
    }

    /// Returns the time of the training up to now, if that of its earlier parts is known.
    std::optional<TrainingTime> time() const {
        if (!earlier_time_) return std::nullopt;
        return TrainingTime{train_seconds_, earlier_time_->data_wait_seconds + views_.wait_seconds(),
                            schedule_.used_seconds()};
    }

    /// After an error: saves the model as the last finished step left it, if there is one and the device still gives it
    /// out. Up to three steps that a failed device had not finished are missing. Returns what the message should say
    /// about it.
    std::string rescue(std::int64_t first) {
        progress_.finish();
        if (iteration_ == first) return "";
        try {
            backend_->synchronize();  // gives up steps that do not fit
        } catch (const std::exception&) {
        }
        try {
            write_checkpoint();
        } catch (const std::exception& e) {  // the error that brought us here is the one to report
            log_warning("no checkpoint could be written: {}", e.what());
            return last_checkpoint();
        }
        return ", checkpoint written to " + writer_.folder().checkpoint(iteration_).string() + "; " + how_to_continue();
    }
    /// Returns what a message should say about the last checkpoint, if there is one.
    std::string last_checkpoint() const {
        try {
            return "; the last checkpoint is " + latest_checkpoint(writer_.folder().root).string() + "; " +
                   how_to_continue();
        } catch (const Error&) {
            return "";
        }
    }
    std::string how_to_continue() const { return "continue with --resume latest -m " + writer_.folder().root.string(); }

    std::unique_ptr<Backend> make_backend(const EngineOptions& options) {
        auto backend = hooks_.make_backend ? hooks_.make_backend(appearance_, options)
                                           : choose_backend(device_, appearance_, options);
        views_.deal(backend->views_per_step(), [&](int k) { return backend->needs_pixels(k); });
        return backend;
    }

    void begin(const TrainOptions& options, double used_seconds, std::optional<InitialModel> initial) {
        if (schedule_.limits_time()) schedule_.charge(used_seconds);
        InitOptions init = init_options(options);
        init.most_points = limits_.most_first_points();
        const bool from_points = !initial;
        Gaussians state = from_points ? initialize_gaussians(scene_, appearance_, init)
                                      : start_from(std::move(*initial), scene_, appearance_, options.seed);
        if (!from_points) densification_.resume(state.active_degree);
        backend_ = make_backend(engine_options(options));
        if (options.frame_limit) {
            InitOptions smallest = init;
            smallest.most_points = 1;
            limits_.require_feasible(*backend_, initialize_gaussians(scene_, appearance_, smallest));
        }
        if (schedule_.limits_time() && from_points && !options.named.contains("init-points")) {
            backend_->upload(state);
            init.most_points = std::min(
                state.count,
                std::max(kLeastPoints, schedule_.affordable_start(state.count, limits_.view_seconds(*backend_))));
            if (init.most_points < state.count) {
                log_debug("time limit {}: begins with {} of {} points, so that there is time for enough steps",
                          options.time_limit->text(), init.most_points, state.count);
                state = initialize_gaussians(scene_, appearance_, init);
            }
        }
        state.active_degree = densification_.active_degree();
        state.ppisp = photometric_.initial_state();
        if (state.count > options.cap_max)
            log_warning("{} initial Gaussians exceed --cap-max {}: they are kept, but none are added", state.count,
                        options.cap_max);
        backend_->upload(state);
        writer_.write_start(initial_points(scene_, init));
    }

    void resume(const TrainOptions& options, Checkpoint checkpoint) {
        if (checkpoint.seed != options.seed)
            log_warning("resuming with --seed {} a run that began with {}: it will differ from an uninterrupted one",
                        options.seed, checkpoint.seed);
        iteration_ = checkpoint.iteration;
        earlier_time_ = checkpoint.time;
        if (earlier_time_)
            checkpoint_seconds_ = train_seconds_ = earlier_time_->train_seconds;
        else
            log_warning("the checkpoint does not say how long its {} iterations took: times count from here",
                        iteration_);
        schedule_.resume(iteration_, earlier_time_ ? earlier_time_->limited_seconds : 0);
        photometric_.resume(checkpoint.state, schedule_.moment());
        densification_.resume(checkpoint.state.active_degree);
        backend_ = make_backend(engine_options(options));
        backend_->upload(checkpoint.state);
        writer_.write_config();
        log_info("resuming at iteration {} with {} Gaussians", iteration_, backend_->count());
        if (schedule_.finished() && options.ends_by_iterations())
            log_warning("the checkpoint already has {} iterations, --iterations is {}: nothing is trained", iteration_,
                        options.iterations);
    }

    void iterate() {
        // First, since it may fail: nothing of this iteration is done yet, and a checkpoint continues before it.
        const std::vector<StepView> steps = next_steps();
        const auto num_views = std::int64_t(steps.size());
        const ScheduleMoment moment = schedule_.moment();
        decide_photometric(moment);
        const bool hold = multiples_passed(moment.before, moment.position, kDegreeInterval) > 0 &&
                          photometric_.holds_view_dependence(*backend_, moment);
        writer_.log_change(
            densification_.before_step(
                *backend_, moment, hold,
                [&] { return schedule_.most_gaussians(backend_->count(), limits_.most_now(*backend_)); }),
            iteration_ + 1);
        report_residuals(residuals_.before_step(*backend_, moment, steps_on_views(moment)), iteration_ + 1);
        std::vector<StepRequest> requests;
        for (const StepView& step : steps) requests.push_back(composer_.compose(step, moment));
        if (num_views > 1) StepComposer::combine(requests);
        backend_->step_on(requests);
        last_moment_ = moment;
        writer_.log_change(densification_.after_step(*backend_, moment), iteration_ + num_views);
        iteration_ += num_views;
        schedule_.advance(backend_->count(), num_views);
        if (iteration_ / kMaxSkips > (iteration_ - num_views) / kMaxSkips) read_stats();
        if (iteration_ % kLogInterval == 0) {
            prune_nonfinite();
            keep_time_for_controllers();
        }
    }

    /// Returns the views of the next step: as many as the backend takes, but no more than there are to the next
    /// iteration at which something may be due.
    std::vector<StepView> next_steps() {
        std::int64_t end = (iteration_ / kLogInterval + 1) * kLogInterval;
        const auto ends_at = [&](std::int64_t iteration) {
            if (iteration > iteration_) end = std::min(end, iteration);
        };
        if (const std::int64_t views = backend_->views_per_step(); views > 1) {
            ends_at(iteration_ + views);
            if (length_.ends_by_iterations()) ends_at(length_.iterations);
            if (output_.preview_every) ends_at((iteration_ / *output_.preview_every + 1) * *output_.preview_every);
            for (const auto* list :
                 {&output_.test_iterations, &output_.save_iterations, &output_.checkpoint_iterations})
                for (std::int64_t iteration : *list) ends_at(iteration);
        } else {
            end = iteration_ + 1;
        }
        std::vector<StepView> steps;
        for (std::int64_t k = 0; iteration_ + k < end; ++k)
            steps.push_back(
                views_.at(iteration_ + k, last_iteration(), schedule_.reduction(), backend_->needs_pixels(int(k))));
        return steps;
    }

    /// Returns where steps on single views at `moment` come from. Each is valid until the next is asked for.
    StepSource steps_on_views(const ScheduleMoment& moment) {
        return [this, moment](std::size_t view) {
            return composer_.compose(StepView{view, views_.image(view), views_.fixed_background()}, moment);
        };
    }

    void report_residuals(const std::optional<ResidualChange>& change, std::int64_t iteration) {
        if (!change) return;
        log_info("iteration {}: {} of {} Gaussians keep a colour that depends on the view ({:.1f} %)", iteration,
                 change->after, backend_->count(),
                 100 * double(change->after) / double(std::max<std::int64_t>(1, backend_->count())));
        writer_.log({{"event", "residuals"},
                     {"iteration", iteration},
                     {"pruned", change->pruned},
                     {"before", change->before},
                     {"after", change->after},
                     {"num_gaussians", backend_->count()},
                     {"loss_dB", change->loss}});
    }

    void decide_photometric(const ScheduleMoment& moment) {
        const auto decision = photometric_.decide(*backend_, moment, views_.fixed_background(),
                                                  [&](std::size_t view) { return views_.image(view); });
        if (!decision) return;
        writer_.log({{"event", "photometric"},
                     {"iteration", iteration_ + 1},
                     {"on", decision->on},
                     {"stops", decision->variation.stops},
                     {"threshold", kPhotometricThreshold},
                     {"images", decision->variation.num_images},
                     {"reason", describe(*decision)}});
        photometric_decision_ = describe(*decision);
    }

    /// Trains the controllers, after the last change of the Gaussians. What it does is in no checkpoint: if it is
    /// stopped, it begins anew in the resumed run.
    void train_controllers() {
        if (!photometric_.trains_controllers()) return;
        photometric_.add_controllers(*backend_);
        // Under a time limit the controllers have what is left of it, unless their number was named.
        const bool by_time = !controller_limit_;
        const auto& budget = schedule_.budget();
        const auto due = [&](std::int64_t k) {
            if (k > 0 && budget && budget->elapsed() >= budget->limit() - kControllerEnd) return false;
            return by_time || k < *controller_limit_;
        };
        const auto expect_controllers_end = [&] {
            if (by_time) progress_.expect_end_in(budget->limit() - kControllerEnd - budget->elapsed());
        };
        progress_.start(controller_limit_.value_or(0), 0, "controller");
        std::int64_t k = 0;
        for (; due(k); ++k) {
            if (interrupted() || ask(false) == WatcherRequest::kStop) {
                progress_.finish();
                throw Interrupted("interrupted after " + std::to_string(k) +
                                  " iterations of the controllers, which are lost; the model is written" +
                                  (schedule_.limits_time() ? "" : " and its checkpoint; " + how_to_continue()));
            }
            const StepView step =
                views_.at(iteration_ + k, by_time ? last_iteration() : iteration_ + *controller_limit_);
            backend_->distill(composer_.compose_distillation(step, iteration_ + k));
            if ((k + 1) % kMaxSkips == 0) read_stats();
            if (progress_.due(k + 1)) {
                settle();
                expect_controllers_end();
                progress_.update(k + 1, last_.loss, backend_->count());
            }
        }
        settle();
        progress_.expect(k);
        progress_.update(k, last_.loss, backend_->count());
        progress_.finish();
        controller_iterations_ = k;
    }

    /// Keeps a share of a time limit for the controllers, as long as they would have in a run of iterations.
    void keep_time_for_controllers() {
        auto& budget = schedule_.budget();
        if (!budget || !photometric_.trains_controllers()) return;
        constexpr double kShare = 1.0 / 7;
        const double mean_step = budget->elapsed() / double(std::max<std::int64_t>(1, iteration_));
        budget->keep_back(controller_limit_ ? std::min(0.5 * budget->limit(), double(*controller_limit_) * mean_step)
                                            : kShare * budget->limit());
    }

    void settle() {
        backend_->synchronize();
        read_stats();
    }

    void read_stats() {
        const StepStats stats = backend_->take_stats();
        nonfinite_gradients_ += stats.num_nonfinite_gradients;
        if (stats.steps > 0) last_ = stats;
        if (stats.consecutive_skips >= kMaxSkips)
            throw NumericError("iteration " + std::to_string(iteration_) + ": the loss of the last " +
                               std::to_string(stats.consecutive_skips) +
                               " views was not finite (last view: " + views_.view_at(iteration_ - 1).name +
                               "). Lower the learning rates, or check the images");
    }

    void prune_nonfinite() {
        const auto [removed, by_group] = backend_->prune_nonfinite();
        if (!removed) return;
        std::string names;
        for (int g = 0; g < kNumGroups; ++g)
            if (by_group[g]) names += (names.empty() ? "" : ", ") + std::to_string(by_group[g]) + " " + kGroupNames[g];
        log_warning("iteration {}: removed {} Gaussians with parameters that are not finite or out of range ({})",
                    iteration_, removed, names);
        writer_.log(
            {{"event", "prune_nonfinite"}, {"iteration", iteration_}, {"removed", removed}, {"parameters", names}});
        pruned_nonfinite_ += removed;
        if (backend_->count() == 0)
            throw NumericError("iteration " + std::to_string(iteration_) +
                               ": no Gaussian with parameters finite and in range is left (" + names + ")");
    }

    void write_log(double interval_seconds) {
        const double wait = views_.wait_seconds();
        writer_.log({{"event", "step"},
                     {"iteration", iteration_},
                     {"loss", last_.loss},
                     {"l1", last_.l1},
                     {"ssim", last_.ssim},
                     {"num_gaussians", backend_->count()},
                     {"num_instances", last_.num_instances},
                     {"active_degree", densification_.active_degree()},
                     {"milliseconds", 1e3 * interval_seconds},
                     {"data_wait_milliseconds", 1e3 * (wait - logged_wait_)},
                     {"train_seconds", train_seconds_}});
        logged_wait_ = wait;
        if (!hooks_.tensorboard) return;
        hooks_.tensorboard->add_rates(iteration_, composer_.rates().at(last_moment_));
    }

    bool something_is_due() const {
        const OutputOptions& o = output_;
        return (o.preview_every && iteration_ % *o.preview_every == 0) ||
               contains(o.checkpoint_iterations, iteration_) || contains(o.save_iterations, iteration_) ||
               contains(o.test_iterations, iteration_);
    }

    void evaluate(bool last) {
        if (const auto scores = hooks_.evaluate(iteration_, *backend_, last))
            writer_.log({{"event", "evaluation"},
                         {"iteration", iteration_},
                         {"psnr", scores->psnr},
                         {"ssim", scores->ssim},
                         {"views", scores->views}});
        writer_.show_preview(*backend_, views_.fixed_background(), iteration_);
    }

    void save_what_is_due() {
        // Whether a segment of a search is the last one is known only when it has been measured.
        const bool last = schedule_.finished() && !length_.target_psnr;
        if (output_.preview_every && iteration_ % *output_.preview_every == 0)
            writer_.write_preview(*backend_, views_.fixed_background(), iteration_);
        if (contains(output_.save_iterations, iteration_) && !last) writer_.write_point_cloud(*backend_, iteration_);
        if (contains(output_.test_iterations, iteration_) && !last && hooks_.evaluate) {
            writer_.write_ppisp(*backend_, iteration_);  // says how these views are corrected
            writer_.check_folder();
            const double start = seconds_now();
            evaluate(false);
            if (auto& budget = schedule_.budget()) budget->leave_out(seconds_now() - start);
        }
        // Last: a run that is killed in between resumes before this iteration and writes the other files once more.
        if (contains(output_.checkpoint_iterations, iteration_) && !last) {
            write_checkpoint();
            checkpoint_seconds_ = train_seconds_;
        }
        save_automatically();
    }

    /// Writes a checkpoint when enough time has passed. The course of the training must not depend on that: it happens
    /// only where the scan for non-finite parameters has just brought all rows of the device up to date, which reading
    /// them would do, too. That it cannot be written is no reason to end the run.
    void save_automatically() {
        const double seconds = train_seconds_ - checkpoint_seconds_, interval = automatic_interval(output_);
        if (iteration_ % kLogInterval != 0 || schedule_.finished() || seconds < interval ||
            contains(output_.checkpoint_iterations, iteration_))
            return;
        checkpoint_seconds_ = train_seconds_;
        writer_.check_folder();
        const double start = seconds_now();
        try {
            write_checkpoint(true);
        } catch (const DataError& e) {
            log_warning("iteration {}: no checkpoint was written: {}", iteration_, e.what());
            return;
        }
        if (std::exchange(automatic_shown_, true)) return;
        std::error_code ignored;
        const auto bytes = std::filesystem::file_size(writer_.folder().checkpoint(iteration_), ignored);
        log_info(
            "iteration {}: checkpoint of {:.1f} MiB written in {:.2f} s; from now on one every {:g} minutes "
            "(--checkpoint-minutes), of which the latest is kept",
            iteration_, double(bytes) / (1024.0 * 1024.0), seconds_now() - start, *output_.checkpoint_minutes);
    }

    TrainSummary finish() {
        const double steps_end = seconds_now();
        progress_.expect(iteration_);
        progress_.update(iteration_, last_.loss, backend_->count());
        progress_.finish();
        const MemoryUse memory = backend_->memory();
        if (memory.peak > 0) log_debug("{}", memory_report(memory));
        log_exchanges(backend_->take_costs());
        prune_nonfinite();
        // Before the final pruning: a longer run goes on from here as if it had not stopped. A time limit is better
        // spent on steps than on a file three times as large as the model.
        if (!schedule_.limits_time()) write_checkpoint();
        writer_.begin_final_lines();
        if (residuals_.views_at_end() > 0)
            timed([&] { remove_surplus(); });  // the last choice is training, what limits take away is saving
        else
            remove_surplus();
        backend_->morton_sort();
        if (backend_->count() == 0)
            throw UsageError(
                "after training no Gaussian is visible (all opacities below 1/255): lower opacity-reg or opacity-lr, "
                "and look whether the images show anything (not one colour, not masked everywhere)");
        writer_.write_point_cloud(*backend_, iteration_);
        if (schedule_.limits_time()) remove_automatic_checkpoints(writer_.folder(), iteration_ + 1);
        const double controllers_start = seconds_now(), saving_seconds = controllers_start - steps_end;
        train_controllers();
        const double controller_seconds = photometric_.trains_controllers() ? seconds_now() - controllers_start : 0;
        if (controller_seconds > 0) writer_.write_ppisp(*backend_, iteration_);
        const double limited_seconds = schedule_.used_seconds();
        const double frame_seconds = limits_.limits_frames() ? limits_.frame_seconds(*backend_) : 0;
        photometric_.report(*backend_);
        if (nonfinite_gradients_)
            log_warning("{} non-finite Gaussian gradients were skipped during the run", nonfinite_gradients_);
        if (pruned_nonfinite_)
            log_warning("{} Gaussians were removed for parameters not finite or out of range during the run",
                        pruned_nonfinite_);
        writer_.check_folder();
        if (hooks_.evaluate) evaluate(true);
        writer_.close_log();
        const bool has_residuals = group_width(Group::kResidual, appearance_) > 0 && backend_->count() > 0;
        return {iteration_,
                backend_->count(),
                has_residuals ? double(backend_->num_residuals()) / double(backend_->count()) : 1,
                train_seconds_,
                views_.wait_seconds() + (earlier_time_ ? earlier_time_->data_wait_seconds : 0),
                memory,
                controller_seconds,
                controller_iterations_,
                saving_seconds,
                frame_seconds,
                limited_seconds,
                length_.target_psnr ? std::optional(search_.outcome()) : std::nullopt,
                photometric_decision_,
                earlier_time_.has_value()};
    }

    const OutputOptions output_;
    const ScheduleOptions length_;
    const Device device_;
    const DensificationOptions densification_options_;
    const std::optional<std::int64_t> controller_limit_;
    const Scene& scene_;
    Progress& progress_;
    const TrainHooks& hooks_;
    AppearanceSpec appearance_;
    TrainingViews views_;
    ModelLimits limits_;
    TrainingSchedule schedule_;
    TargetSearch search_;
    DensificationSchedule densification_;
    Photometric photometric_;
    const StepComposer composer_;
    const ResidualShare residuals_;
    RunWriter writer_;
    std::unique_ptr<Backend> backend_;
    std::optional<Gaussians> kept_;  ///< in the search for a target: the smallest model that reached it
    std::int64_t iteration_ = 0;     ///< finished iterations
    StepStats last_;
    ScheduleMoment last_moment_;
    double train_seconds_ = 0, logged_wait_ = 0;
    std::optional<TrainingTime> earlier_time_ = TrainingTime{};  ///< of the parts before a resume; empty = unknown
    double checkpoint_seconds_ = 0;                              ///< train_seconds_ at the last checkpoint
    bool automatic_shown_ = false;                               ///< what such a checkpoint costs
    std::string photometric_decision_;
    std::int64_t controller_iterations_ = 0;
    std::int64_t nonfinite_gradients_ = 0, pruned_nonfinite_ = 0;
};

}  // namespace

TrainSummary train(const TrainOptions& options, const Scene& scene, RunStart start, Progress& progress,
                   const TrainHooks& hooks) {
    if (scene.train.empty()) throw DataError(scene.source + ": no training views (all were held out or skipped)");
    return Run(options, scene, std::move(start), progress, hooks).run();
}

}  // namespace gs
