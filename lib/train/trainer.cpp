// SPDX-License-Identifier: Apache-2.0
#include "lib/train/trainer.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <new>
#include <optional>

#include "kernels/core/error.h"
#include "kernels/core/parallel.h"
#include "lib/core/interrupt.h"
#include "lib/core/options.h"
#include "lib/io/atomic_file.h"
#include "lib/io/safetensors.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/cameras_json.h"
#include "lib/model/hostile_start.h"
#include "lib/model/initialize.h"
#include "lib/model/ply.h"
#include "lib/scene/camera_params.h"
#include "lib/train/choose_backend.h"
#include "lib/train/densification.h"
#include "lib/train/learning_rates.h"
#include "lib/train/memory_plan.h"
#include "lib/train/photometric.h"
#include "lib/train/train_log.h"
#include "lib/train/training_views.h"

namespace gs {
namespace {

/// Iterations between log lines, which are also the scans for non-finite parameters: one pass over the model is then
/// below a hundredth of the work.
constexpr std::int64_t kLogInterval = 100;
/// A loss that is not finite this often in a row does not recover. Also the iterations between two looks at the statistics:
/// a device may be behind, and asking it each time would make it wait.
constexpr std::int64_t kMaxSkips = 10;

double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

bool contains(const std::vector<std::int64_t>& list, std::int64_t value) { return std::find(list.begin(), list.end(), value) != list.end(); }

class Run {
  public:
    Run(const TrainOptions& options, const Scene& scene, RunStart start, Progress& progress, const TrainHooks& hooks)
        : options_(options),
          scene_(scene),
          folder_(std::move(start.folder)),
          progress_(progress),
          hooks_(hooks),
          appearance_(appearance_spec(options)),
          views_(options_, scene),
          rates_(options, appearance_, scene),
          schedule_(options_, appearance_, scene.extent, options.background == "black", training_views()),
          photometric_(options_, scene) {
        set_num_threads(options.threads);
        rates_.log(options_);
        if (start.checkpoint)
            resume(std::move(*start.checkpoint));
        else
            begin();
        log_memory_plan(options_, scene_, appearance_, backend_->count());
        log_.emplace(folder_.train_log(), iteration_);
        if (!start.first_event.is_null()) {
            start.first_event["iteration"] = 0;
            log_->write(start.first_event);
        }
        prune_nonfinite(); // before such a Gaussian leaves its mark in the moments of all that it covers
    }

    TrainSummary run() {
        progress_.start(options_.iterations, iteration_);
        views_.prefetch(iteration_, options_.iterations);
        const std::int64_t first = iteration_;
        try {
            loop();
        } catch (const DeviceError& e) {
            throw DeviceError(e.what() + rescue(first));
        } catch (const std::bad_alloc&) {
            throw DeviceError("out of memory; lower --cap-max, --resolution or --image-cache" + rescue(first));
        }
        return finish();
    }

  private:
    void loop() {
        double interval_start = now();
        while (iteration_ < options_.iterations) {
            timed([&] { iterate(); });
            const bool log = iteration_ % kLogInterval == 0 || iteration_ == options_.iterations, report = progress_.due(iteration_);
            const bool stop = interrupted() && iteration_ < options_.iterations;
            // What is reported or saved is the state after this iteration, and waiting for it is training time.
            if (log || report || stop || something_is_due()) timed([&] { settle(); });
            if (log) {
                write_log(now() - interval_start);
                interval_start = now();
            }
            if (report) progress_.update(iteration_, last_.loss, backend_->count());
            save_what_is_due();
            if (stop) {
                save_checkpoint();
                progress_.finish();
                throw Interrupted("interrupted after " + std::to_string(iteration_) + " iterations; " + how_to_continue());
            }
        }
    }

    /// On one background, black where that of the steps is random: scores compare Gaussians, not backgrounds.
    std::vector<RenderRequest> training_views() const {
        std::vector<RenderRequest> views(scene_.train.size());
        for (std::size_t k = 0; k < views.size(); ++k) {
            views[k].camera = camera_params(scene_.train[k].camera);
            views[k].background = views_.fixed_background();
        }
        return views;
    }

    template <class Fn> void timed(Fn&& fn) {
        const double start = now();
        fn();
        train_seconds_ += now() - start;
    }

    /// After an error of the device: saves the model as the last finished step left it, if there is one and the device still
    /// gives it out. Up to three steps that it had not finished are missing. Returns what the message should say about it.
    std::string rescue(std::int64_t first) {
        progress_.finish();
        if (iteration_ == first) return "";
        try {
            backend_->synchronize(); // gives up steps that do not fit
        } catch (const std::exception&) {
        }
        try {
            save_checkpoint();
        } catch (const std::exception& e) { // the error that brought us here is the one to report
            spdlog::warn("no checkpoint could be written: {}", e.what());
            return "";
        }
        return ", checkpoint written to " + folder_.checkpoint(iteration_).string() + "; " + how_to_continue();
    }
    std::string how_to_continue() const { return "continue with --resume latest -m " + folder_.root.string(); }

    std::unique_ptr<Backend> make_backend() const {
        const BackendOptions options = backend_options(options_);
        return hooks_.make_backend ? hooks_.make_backend(appearance_, options) : choose_backend(options_.device, appearance_, options);
    }

    void begin() {
        const InitOptions init = init_options(options_);
        Gaussians state = initialize_gaussians(scene_, appearance_, init);
        if (options_.hostile_start > 0)
            spdlog::warn("--hostile-start {}: {} of {} Gaussians begin with extreme parameters", options_.hostile_start,
                         make_hostile(state, options_.hostile_start, options_.seed), state.count);
        state.active_degree = schedule_.active_degree();
        state.ppisp = photometric_.initial_state();
        if (state.count > options_.cap_max)
            spdlog::warn("{} initial Gaussians exceed --cap-max {}: they are kept, but none are added", state.count, options_.cap_max);
        backend_ = make_backend();
        backend_->upload(state);
        write_text_atomic(folder_.config(), options_to_yaml(options_));
        write_cfg_args(folder_, options_);
        write_cameras_json(folder_.cameras(), scene_);
        write_input_points(folder_, initial_points(scene_, init));
    }

    void resume(Checkpoint checkpoint) {
        if (checkpoint.seed != options_.seed)
            spdlog::warn("resuming with --seed {} a run that began with {}: it will differ from an uninterrupted one", options_.seed, checkpoint.seed);
        iteration_ = checkpoint.iteration;
        photometric_.resume(checkpoint.state, iteration_);
        schedule_.resume(checkpoint.state.active_degree);
        backend_ = make_backend();
        backend_->upload(checkpoint.state);
        write_text_atomic(folder_.config(), options_to_yaml(options_));
        spdlog::info("resuming at iteration {} with {} Gaussians", iteration_, backend_->count());
        if (iteration_ >= options_.iterations)
            spdlog::warn("the checkpoint already has {} iterations, --iterations is {}: nothing is trained", iteration_, options_.iterations);
    }

    void iterate() {
        decide_photometric();
        const bool hold = iteration_ % kDegreeInterval == 0 && photometric_.holds_view_dependence(*backend_, iteration_);
        write_change(schedule_.before_step(*backend_, iteration_, hold));
        auto [view, image, request] = views_.at(iteration_, options_.iterations);
        const bool mcmc = options_.strategy == "mcmc";
        request.opacity_reg = mcmc ? float(options_.opacity_reg) : 0.0f;
        request.scale_reg = mcmc ? float(options_.scale_reg) : 0.0f;
        request.gather_gradient_stats = schedule_.gathers(iteration_);
        rates_.apply(iteration_, request);
        photometric_.apply(view, iteration_, request);
        backend_->step(request);
        write_change(schedule_.after_step(*backend_, iteration_));
        ++iteration_;
        if (iteration_ % kMaxSkips == 0) read_stats();
        if (iteration_ % kLogInterval == 0) prune_nonfinite();
    }

    void decide_photometric() {
        const auto decision = photometric_.decide(*backend_, iteration_, views_.fixed_background(), [&](std::size_t view) { return views_.image(view); });
        if (!decision) return;
        log_->write({{"event", "photometric"}, {"iteration", iteration_ + 1}, {"on", decision->on}, {"stops", decision->variation.stops},
                     {"threshold", kPhotometricThreshold}, {"images", decision->variation.num_images}, {"reason", describe(*decision)}});
        photometric_decision_ = describe(*decision);
    }

    /// After the last change of the Gaussians. What it does is in no checkpoint: stopped, it begins anew in the resumed run.
    void train_controllers() {
        if (!photometric_.trains_controllers()) return;
        photometric_.add_controllers(*backend_);
        progress_.start(options_.controller_iterations, 0, "controller");
        for (std::int64_t k = 0; k < options_.controller_iterations; ++k) {
            if (interrupted()) {
                progress_.finish();
                throw Interrupted("interrupted after " + std::to_string(k) + " iterations of the controllers, which are lost; the model and its checkpoint are written; " +
                                  how_to_continue());
            }
            auto [view, image, request] = views_.at(iteration_ + k, iteration_ + options_.controller_iterations);
            photometric_.apply_controller(view, request);
            backend_->distill(request);
            if ((k + 1) % kMaxSkips == 0) read_stats();
            if (progress_.due(k + 1)) {
                settle();
                progress_.update(k + 1, last_.loss, backend_->count());
            }
        }
        settle();
        progress_.finish();
    }

    void write_change(const ScheduledChange& change) {
        if (change.relocated || change.added || change.cloned || change.split || change.pruned)
            log_->write({{"event", "densify"}, {"iteration", iteration_ + 1}, {"relocated", change.relocated}, {"added", change.added},
                         {"cloned", change.cloned}, {"split", change.split}, {"pruned", change.pruned},
                         {"num_gaussians", change.count + change.pruned_by_score}});
        if (change.pruned_by_score)
            log_->write({{"event", "prune_by_score"}, {"iteration", iteration_ + 1}, {"pruned", change.pruned_by_score}, {"num_gaussians", change.count}});
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
            throw NumericError("iteration " + std::to_string(iteration_) + ": the loss of the last " + std::to_string(stats.consecutive_skips) +
                               " views was not finite (last view: " + views_.view_at(iteration_ - 1).name +
                               "). Lower the learning rates, or check the images");
    }

    void prune_nonfinite() {
        std::int64_t by_group[kNumGroups];
        const std::int64_t removed = backend_->prune_nonfinite(by_group);
        if (!removed) return;
        std::string names;
        for (int g = 0; g < kNumGroups; ++g)
            if (by_group[g]) names += (names.empty() ? "" : ", ") + std::to_string(by_group[g]) + " " + kGroupNames[g];
        spdlog::warn("iteration {}: removed {} Gaussians with parameters that are not finite or out of range ({})", iteration_, removed, names);
        log_->write({{"event", "prune_nonfinite"}, {"iteration", iteration_}, {"removed", removed}, {"parameters", names}});
        pruned_nonfinite_ += removed;
        if (backend_->count() == 0)
            throw NumericError("iteration " + std::to_string(iteration_) + ": no Gaussian with parameters finite and in range is left (" + names + ")");
    }

    void write_log(double interval_seconds) {
        const double wait = views_.wait_seconds();
        log_->write({{"event", "step"},
                     {"iteration", iteration_},
                     {"loss", last_.loss},
                     {"l1", last_.l1},
                     {"ssim", last_.ssim},
                     {"num_gaussians", backend_->count()},
                     {"num_instances", last_.num_instances},
                     {"active_degree", schedule_.active_degree()},
                     {"milliseconds", 1e3 * interval_seconds},
                     {"data_wait_milliseconds", 1e3 * (wait - logged_wait_)},
                     {"train_seconds", train_seconds_}});
        logged_wait_ = wait;
    }

    bool something_is_due() const {
        const auto& o = options_;
        return (o.preview_every > 0 && iteration_ % o.preview_every == 0) || contains(o.checkpoint_iterations, iteration_) ||
               contains(o.save_iterations, iteration_) || contains(o.test_iterations, iteration_);
    }

    void save_what_is_due() {
        const bool last = iteration_ == options_.iterations;
        if (options_.preview_every > 0 && iteration_ % options_.preview_every == 0) save_preview();
        if (contains(options_.checkpoint_iterations, iteration_) && !last) save_checkpoint();
        if (contains(options_.save_iterations, iteration_) && !last) save_ply();
        if (contains(options_.test_iterations, iteration_) && !last && hooks_.evaluate) {
            photometric_.save(folder_.ppisp(), *backend_, iteration_); // says how these views are corrected
            hooks_.evaluate(iteration_, *backend_);
        }
    }

    TrainSummary finish() {
        progress_.update(iteration_, last_.loss, backend_->count());
        progress_.finish();
        const MemoryUse memory = backend_->memory();
        if (memory.peak > 0) spdlog::info("{}", memory_report(memory));
        prune_nonfinite();
        save_checkpoint(); // before the final pruning: a longer run goes on from here as if it had not stopped
        backend_->prune_invisible();
        backend_->morton_sort();
        if (backend_->count() == 0) throw NumericError("after training no Gaussian is visible (all opacities below 1/255)");
        save_ply();
        const double controllers_start = now();
        train_controllers();
        const double controller_seconds = photometric_.trains_controllers() ? now() - controllers_start : 0;
        if (controller_seconds > 0) photometric_.save(folder_.ppisp(), *backend_, iteration_);
        photometric_.report(*backend_);
        if (nonfinite_gradients_) spdlog::warn("{} non-finite Gaussian gradients were skipped during the run", nonfinite_gradients_);
        if (pruned_nonfinite_) spdlog::warn("{} Gaussians were removed for parameters not finite or out of range during the run", pruned_nonfinite_);
        if (hooks_.evaluate) hooks_.evaluate(iteration_, *backend_);
        return {iteration_, backend_->count(), train_seconds_, views_.wait_seconds(), memory, controller_seconds, photometric_decision_};
    }

    void save_checkpoint() {
        write_checkpoint(folder_.checkpoint(iteration_), {backend_->download(true), iteration_, options_.seed, options_to_yaml(options_)});
    }
    void save_ply() {
        PlyOptions ply;
        ply.iteration = iteration_;
        write_ply(folder_.point_cloud(iteration_), backend_->download(false), ply);
        photometric_.save(folder_.ppisp(), *backend_, iteration_);
    }
    void save_preview() {
        const View& view = scene_.test.empty() ? scene_.train.front() : scene_.test.front();
        RenderRequest request;
        request.camera = camera_params(view.camera);
        request.background = views_.fixed_background();
        request.isp = photometric_.active() ? IspView{.mode = IspMode::kFrame, .camera = std::max(0, view.camera_id)} : IspView{};
        RenderedImage rendered;
        backend_->render(request, rendered);
        Image image{rendered.width, rendered.height, 3, {}, {}};
        const std::size_t pixels = rendered.alpha.size();
        image.f32.resize(3 * pixels);
        for (std::size_t i = 0; i < pixels; ++i)
            for (std::size_t c = 0; c < 3; ++c) image.f32[3 * i + c] = rendered.rgb[c * pixels + i];
        write_image(folder_.preview(iteration_), image);
    }

    const TrainOptions options_;
    const Scene& scene_;
    RunFolder folder_;
    Progress& progress_;
    const TrainHooks& hooks_;
    AppearanceSpec appearance_;
    TrainingViews views_;
    LearningRates rates_;
    DensificationSchedule schedule_;
    Photometric photometric_;
    std::unique_ptr<Backend> backend_;
    std::optional<TrainLog> log_;
    std::int64_t iteration_ = 0; ///< finished iterations
    StepStats last_;
    double train_seconds_ = 0, logged_wait_ = 0;
    std::string photometric_decision_;
    std::int64_t nonfinite_gradients_ = 0, pruned_nonfinite_ = 0;
};

std::filesystem::path resumed_file(const TrainOptions& options) {
    return options.resume == "latest" ? latest_checkpoint(options.model) : std::filesystem::path(options.resume);
}

}  // namespace

std::string checkpoint_appearance(const TrainOptions& options) { return SafetensorsFile(resumed_file(options)).metadata("appearance"); }

RunStart open_run(const TrainOptions& options) {
    RunStart start{RunFolder{options.model}, std::nullopt, {}};
    if (!options.resume.empty()) {
        const auto file = resumed_file(options);
        start.checkpoint = read_checkpoint(file);
        require_same_appearance(start.checkpoint->state.appearance, appearance_spec(options), file.string());
        prepare_run_folder(start.folder, options.overwrite, start.checkpoint->iteration);
    } else {
        prepare_run_folder(start.folder, options.overwrite);
    }
    return start;
}

TrainSummary train(const TrainOptions& options, const Scene& scene, RunStart start, Progress& progress, const TrainHooks& hooks) {
    if (scene.train.empty()) throw DataError(scene.source + ": no training views (all were held out or skipped)");
    return Run(options, scene, std::move(start), progress, hooks).run();
}

}  // namespace gs
