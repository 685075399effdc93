// SPDX-License-Identifier: Apache-2.0
// The training loop: the iterations, the output between them, and the end of the run.
#include "lib/train/trainer.h"

#include <filesystem>
#include <new>
#include <optional>
#include <utility>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/quantities.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/checkpoints.h"
#include "lib/train/controllers.h"
#include "lib/train/journal.h"
#include "lib/train/model_limits.h"
#include "lib/train/output_schedule.h"
#include "lib/train/run_costs.h"
#include "lib/train/run_writer.h"
#include "lib/train/step_monitor.h"
#include "lib/train/step_runner.h"
#include "lib/train/target_search.h"
#include "lib/train/training_clock.h"
#include "lib/train/training_schedule.h"
#include "lib/train/training_start.h"

namespace gs {
namespace {

class Trainer {
  public:
    Trainer(const TrainOptions& options, Scene& scene, RunStart start, Progress& progress, const TrainHooks& hooks)
        : options_(options),
          hooks_(hooks),
          progress_(progress),
          limits_(options, scene, options.background.color, hooks.most_gaussians),
          schedule_(options, scene.train.size()),
          journal_(start.folder, start.lock, hooks.tensorboard),
          steps_(options, scene, appearance_spec(options), limits_, schedule_, journal_),
          clock_(schedule_, steps_.views()),
          writer_(start.folder, start.lock, std::move(start.cameras), options, scene, steps_.photometric(),
                  hooks.tensorboard),
          monitor_(schedule_, steps_.views(), journal_),
          watcher_(hooks, schedule_, monitor_, clock_),
          backend_(TrainingStart(options, scene, hooks, limits_, schedule_, steps_, clock_, writer_).make(start)),
          checkpoints_(options, schedule_, clock_, steps_.cameras(), writer_) {
        log_memory_plan(options, scene, appearance_spec(options), backend_->count());
        if (start.checkpoint)
            journal_.resume(iteration(), schedule_.finished());
        else
            journal_.open();
        for (nlohmann::json& event : start.first_events) {
            event["iteration"] = 0;
            journal_.write(event);
        }
        // A non-finite Gaussian must be removed before it corrupts the moments of all Gaussians that it covers.
        monitor_.prune_nonfinite(*backend_);
    }

    /// Trains to the end. If the model survives an error, the rethrown error names the checkpoint that saves the model.
    TrainSummary run() {
        if (schedule_.limits_time()) start_time_limit();
        progress_.start(schedule_.expected_iterations(), iteration());
        expect_end();
        steps_.prefetch();
        std::optional<TargetOutcome> target;
        try {
            if (options_.target_psnr)
                target = search_target();
            else
                loop();
        } catch (const DeviceError& e) {
            throw DeviceError(e.what() + rescue());
        } catch (const std::bad_alloc&) {
            throw DeviceError("out of memory; lower --cap-max, --resolution or --image-cache" + rescue());
        } catch (const DataError& e) {  // an image that has become unreadable, or a file that cannot be written
            throw DataError(e.what() + rescue());
        }
        try {
            return finish(target);
        } catch (const DataError& e) {
            std::error_code ignored;
            if (!std::filesystem::exists(writer_.folder().checkpoint(iteration()), ignored))
                throw DataError(e.what() + rescue());
            throw DataError(e.what() + ("; the training itself is saved, " + checkpoints_.how_to_continue()));
        }
    }

  private:
    /// Measures the costs that a time limit must allow for, and starts its clock.
    void start_time_limit() {
        const std::int64_t count = backend_->count();
        TimeCosts costs{.saving_per_gaussian = writer_.seconds_per_gaussian(*backend_)};
        costs.at_end = steps_.seconds_to_remove(*backend_);
        if (options_.target_psnr) {
            const double start = seconds_now();
            hooks_.held_out_psnr(*backend_);
            costs.at_end += seconds_now() - start;
        }
        costs.coarse_ratio = limits_.coarse_ratio(*backend_, schedule_.reduction());
        schedule_.start(costs, count);
        keep_time_for_controllers();
        if (schedule_.finished())
            log_warning("time limit {}: it is used up: nothing is trained", options_.time_limit->text());
        log_debug(
            "time limit {}: saving takes about {:.2f} s for {} Gaussians; growth ends when fewer than {} steps would "
            "remain",
            options_.time_limit->text(), costs.saving_per_gaussian * double(count), count, schedule_.wanted_steps());
    }

    /// Returns the number of finished iterations.
    std::int64_t iteration() const { return schedule_.iteration(); }

    /// Trains to the end of the schedule. After each iteration writes the outputs that are due, and polls the watcher.
    void loop() {
        LongTrainingWarning long_training(options_, steps_.views().mean_pixels(), limits_.cap(), iteration(),
                                          clock_.train_seconds());
        bool stop = watch() == WatcherRequest::kStop;
        double interval_start = seconds_now();
        while (!schedule_.finished()) {
            clock_.count([&] { iterate(); });
            long_training.update(iteration(), clock_.train_seconds(), backend_->count());
            const bool log = iteration() % kLogInterval == 0 || schedule_.finished(),
                       report = progress_.due(iteration());
            stop = (stop || interrupted()) && !schedule_.finished();
            // Reports and files hold the state after this iteration, and waiting for that state is training time.
            if (log || report || stop || output_is_due(options_, iteration()))
                clock_.count([&] { monitor_.settle(*backend_); });
            if (log) {
                write_step_line(seconds_now() - interval_start);
                interval_start = seconds_now();
            }
            if (report) {
                expect_end();
                show_progress();
            }
            save_what_is_due();
            const double watch_start = seconds_now();
            stop = (watch() == WatcherRequest::kStop || stop) && !schedule_.finished();
            interval_start += seconds_now() - watch_start;
            if (stop) {
                checkpoints_.write(*backend_);
                progress_.finish();
                throw Interrupted("interrupted after " + std::to_string(iteration()) + " iterations; " +
                                  checkpoints_.how_to_continue());
            }
        }
    }

    /// Takes one step, and periodically checks that all numbers are finite.
    void iterate() {
        const std::int64_t before = iteration();
        steps_.take(*backend_);
        if (iteration() / kStatsInterval > before / kStatsInterval) monitor_.read(*backend_);
        if (iteration() % kLogInterval == 0) {
            monitor_.prune_nonfinite(*backend_);
            keep_time_for_controllers();
        }
    }

    void keep_time_for_controllers() {
        if (steps_.photometric().trains_controllers())
            schedule_.keep_back_for_controllers(options_.controller_iterations);
    }

    /// Sends the expected end of the training to the progress line.
    void expect_end() {
        if (const std::optional<double> left = schedule_.seconds_left())
            progress_.expect_end_in(*left);
        else
            progress_.expect(schedule_.expected_iterations());
    }

    void show_progress() { progress_.update(iteration(), monitor_.last().loss, backend_->count()); }

    void write_step_line(double seconds) {
        journal_.write_step({.stats = monitor_.last(),
                             .num_gaussians = backend_->count(),
                             .active_degree = steps_.active_degree(),
                             .seconds = seconds,
                             .data_wait_seconds = steps_.views().wait_seconds(),
                             .train_seconds = clock_.train_seconds(),
                             .rates = steps_.last_rates()},
                            iteration());
    }

    /// Reports the state of the training to its watcher, saves it on request, and returns the watcher's request.
    WatcherRequest watch() {
        const WatcherRequest request = watcher_.ask(*backend_, iteration() % kLogInterval == 0);
        if (request == WatcherRequest::kSave)
            clock_.leave_out([&] { hooks_.saved(iteration(), checkpoints_.write_with_points(*backend_)); });
        return request;
    }

    void save_what_is_due() {
        // The last segment of a search is known as such only after its measurement.
        const bool last = schedule_.finished() && !options_.target_psnr;
        if (preview_is_due(options_, iteration()))
            writer_.write_preview(*backend_, steps_.views().fixed_background(), iteration());
        if (lists(options_.save_iterations, iteration()) && !last) writer_.write_point_cloud(*backend_, iteration());
        if (lists(options_.test_iterations, iteration()) && !last && hooks_.evaluate) {
            writer_.write_ppisp(*backend_, iteration());  // holds the correction of these views
            writer_.check_folder();
            clock_.leave_out([&] { evaluate(false); });
        }
        // The checkpoint comes last: a run that is killed before it resumes from an earlier iteration and writes the
        // other files again.
        if (lists(options_.checkpoint_iterations, iteration()) && !last) checkpoints_.write(*backend_);
        checkpoints_.write_by_time(*backend_);
    }

    /// Scores the test views, and shows one of them in TensorBoard.
    void evaluate(bool last) {
        if (const auto scores = hooks_.evaluate(iteration(), *backend_, last))
            journal_.write_evaluation(*scores, iteration());
        writer_.show_preview(*backend_, steps_.views().fixed_background(), iteration());
    }

    /// Saves the model after an error. Returns the text to append to the error message.
    std::string rescue() {
        progress_.finish();
        return checkpoints_.rescue(*backend_);
    }

    /// Trains segment after segment until the search ends. Returns the outcome.
    TargetOutcome search_target() {
        TargetSearch search(*options_.target_psnr, steps_.views().count(), options_.iterations, limits_.cap());
        if (const ScheduleSegment first = search.first(iteration(), backend_->count()); first.steps > 0) {
            schedule_.begin(first, backend_->count());
            loop();
        }
        while (true) {
            const TargetStep step = search.next(measure());
            if (step.keep) checkpoints_.keep(backend_->download(true));
            if (step.restore) backend_->upload(*checkpoints_.kept());
            if (step.segment.steps == 0) break;
            schedule_.begin(step.segment, backend_->count());
            if (schedule_.finished()) {
                search.stop("the time limit ends");
                break;
            }
            if (step.prune_to > 0) clock_.count([&] { limits_.prune_to(*backend_, step.prune_to, "target"); });
            loop();
        }
        checkpoints_.keep(std::nullopt);
        progress_.finish();
        const TargetOutcome outcome = search.outcome();
        if (outcome.reached)
            log_info("{}", outcome.verdict);
        else
            log_warning("{}", outcome.verdict);
        return outcome;
    }

    /// Measures the model in the form in which it would be saved now.
    MeasuredModel measure() {
        clock_.count([&] {
            monitor_.settle(*backend_);
            steps_.remove_surplus(*backend_);
        });
        const HeldOutPsnr psnr = hooks_.held_out_psnr(*backend_);
        const MeasuredModel measured{iteration(), backend_->count(), psnr.mean, psnr.standard_error};
        journal_.write_target(measured);
        return measured;
    }

    /// Saves the model, trains the PPISP controllers and scores the test views.
    TrainSummary finish(const std::optional<TargetOutcome>& target) {
        const double steps_end = seconds_now();
        progress_.expect(iteration());
        show_progress();
        progress_.finish();
        const MemoryUse memory = backend_->memory();
        if (memory.peak > 0) log_debug("{}", memory_report(memory));
        log_exchanges(backend_->take_costs());
        monitor_.prune_nonfinite(*backend_);
        save_model();
        report_cameras();
        const double saved = seconds_now();
        const std::int64_t controller_iterations = train_controllers();
        const double controller_seconds = steps_.photometric().trains_controllers() ? seconds_now() - saved : 0;
        if (controller_seconds > 0) writer_.write_ppisp(*backend_, iteration());
        const double limited_seconds = schedule_.used_seconds();
        const double frame_seconds = limits_.limits_frames() ? limits_.frame_seconds(*backend_) : 0;
        steps_.photometric().report(*backend_);
        monitor_.report();
        writer_.check_folder();
        if (hooks_.evaluate) evaluate(true);
        journal_.close();
        return {.iterations = iteration(),
                .num_gaussians = backend_->count(),
                .residual_share = residual_share(),
                .train_seconds = clock_.train_seconds(),
                .data_wait_seconds = clock_.data_wait_seconds(),
                .memory = memory,
                .controller_seconds = controller_seconds,
                .controller_iterations = controller_iterations,
                .saving_seconds = saved - steps_end,
                .frame_seconds = frame_seconds,
                .limited_seconds = limited_seconds,
                .target = target,
                .photometric = journal_.reason("photometric"),
                .refine_cameras = journal_.reason("refine_cameras"),
                .whole_time = clock_.knows_all()};
    }

    /// Writes the last checkpoint, and the point cloud without surplus Gaussians and residuals.
    void save_model() {
        // The checkpoint precedes the final pruning, so that a longer run continues as if it had not stopped. Under a
        // time limit there is none: steps are a better use of the time than a file three times as large as the model.
        if (!schedule_.limits_time()) checkpoints_.write(*backend_);
        journal_.begin_final_lines();
        if (steps_.chooses_residuals())
            clock_.count([&] { steps_.remove_surplus(*backend_); });
        else
            steps_.remove_surplus(*backend_);
        backend_->morton_sort();
        if (backend_->count() == 0)
            throw UsageError(
                "after training no Gaussian is visible (all opacities below 1/255): lower opacity-reg or opacity-lr, "
                "and look whether the images show anything (not one colour, not masked everywhere)");
        writer_.write_point_cloud(*backend_, iteration());
        if (schedule_.limits_time()) remove_automatic_checkpoints(writer_.folder(), iteration() + 1);
    }

    /// Says how far the learned cameras have moved, and writes them.
    void report_cameras() {
        if (!steps_.cameras().is_active()) return;
        const CameraCorrections moved = steps_.cameras().corrections();
        log_info("cameras: moved by {:.2f} pixels in the median, {:.2f} at most; focal lengths by up to {:.2g} %",
                 moved.median, moved.largest, 100 * moved.focal);
        writer_.write_refined_cameras(moved.pixels);
    }

    /// Trains the controllers if the run has any. Returns the number of their iterations.
    std::int64_t train_controllers() {
        if (!steps_.photometric().trains_controllers()) return 0;
        const ControllerTraining done = gs::train_controllers(*backend_, options_.controller_iterations, schedule_,
                                                              steps_, monitor_, watcher_, progress_);
        if (done.stopped)
            throw Interrupted(
                "interrupted after " + std::to_string(done.iterations) +
                " iterations of the controllers, which are lost; the model is written" +
                (schedule_.limits_time() ? "" : " and its checkpoint; " + checkpoints_.how_to_continue()));
        return done.iterations;
    }

    /// Returns the share of Gaussians that have a residual; 1 for a model without residuals.
    double residual_share() const {
        const std::int64_t count = backend_->count();
        if (count == 0 || group_width(Group::kResidual, appearance_spec(options_)) == 0) return 1;
        return double(backend_->num_residuals()) / double(count);
    }

    // Each member uses only the members above it.
    const TrainOptions& options_;
    const TrainHooks& hooks_;
    Progress& progress_;
    ModelLimits limits_;
    TrainingSchedule schedule_;
    Journal journal_;
    StepRunner steps_;
    TrainingClock clock_;
    RunWriter writer_;
    StepMonitor monitor_;
    Watcher watcher_;
    std::unique_ptr<Backend> backend_;
    Checkpoints checkpoints_;
};

}  // namespace

TrainSummary train(const TrainOptions& options, Scene& scene, RunStart start, Progress& progress,
                   const TrainHooks& hooks) {
    if (scene.train.empty()) throw DataError(scene.source + ": no training views (all were held out or skipped)");
    return Trainer(options, scene, std::move(start), progress, hooks).run();
}

}  // namespace gs
