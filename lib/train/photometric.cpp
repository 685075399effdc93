// SPDX-License-Identifier: Apache-2.0
// Corrects differences of photographs in exposure and white balance with PPISP.
#include "lib/train/photometric.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "kernels/base/error.h"
#include "lib/core/log.h"

namespace gs {
namespace {

/// The largest number of names listed in a message.
constexpr std::size_t kNamed = 3;

}  // namespace

double exposure_spread(const PpispState& state) {
    double mean = 0, square = 0;
    for (int f = 0; f < state.num_frames; ++f) {
        const double exposure = state.param[std::size_t(f) * kIspFrameValues];
        mean += exposure / state.num_frames, square += exposure * exposure / state.num_frames;
    }
    return std::sqrt(std::max(0.0, square - mean * mean));
}

double ppisp_rate(double rate, double distance) {
    constexpr double kWarmUp = 500, kDecay = 30000, kFirst = 0.01, kLast = 0.01;
    const double n = std::max(0.0, distance);
    return rate * (n < kWarmUp ? kFirst + (1 - kFirst) * n / kWarmUp : std::pow(kLast, (n - kWarmUp) / kDecay));
}

Photometric::Photometric(const TrainOptions& options, const Scene& scene)
    : options_(options),
      exif_(options.ppisp_exif),
      seed_(options.seed),
      longest_hold_(options.schedule == ScheduleKind::kFixed ? std::min(kLongestHold, double(options.iterations / 3))
                                                             : kLongestHold),
      scene_(scene) {
    if (options.ppisp == PpispMode::kAuto)
        throw UsageError("option ppisp: auto must be decided before a training begins");
    file_.exif = exif_;
    double known = 0;
    for (const View& view : scene.train) {
        file_.frames.push_back({view.name, view.camera_id, view.exif_exposure});
        if (view.exif_exposure) file_.mean_exif += (*view.exif_exposure - file_.mean_exif) / ++known;
    }
    if (!options.ppisp_from.empty())
        take_from(options.ppisp_from);
    else if (options.ppisp == PpispMode::kOn)
        initial_ = begin();
    active_ = initial_.active();
    if (active_)
        log_debug("photometric correction of {} images from {} cameras{}", initial_.num_frames, initial_.num_cameras,
                  frozen_ ? ", as in " + options.ppisp_from : "");
}

PpispState Photometric::begin() const {
    PpispState state = identity_ppisp(int(scene_.train.size()), scene_.num_cameras);
    for (std::size_t k = 0; k < scene_.train.size(); ++k) state.param[k * kIspFrameValues] = prior(k);
    return state;
}

float Photometric::prior(std::size_t view) const {
    const auto& exposure = file_.frames[view].exif_exposure;
    return file_.exif && exposure ? float(*exposure - file_.mean_exif) : 0.0f;
}

void Photometric::take_from(const std::filesystem::path& path) {
    PpispFile from = read_ppisp_json(path);
    if (from.exif != exif_)
        throw UsageError(fmt::format(
            "option ppisp-from: {} was made {} --ppisp-exif, which its controller depends on; {} it here as well",
            path.string(), from.exif ? "with" : "without", from.exif ? "give" : "leave out"));
    if (from.state.num_cameras != scene_.num_cameras)
        throw DataError(fmt::format("{}: {} cameras, but the images of {} come from {}", path.string(),
                                    from.state.num_cameras, scene_.source, scene_.num_cameras));
    std::map<std::string, std::size_t> index;
    for (std::size_t k = 0; k < from.frames.size(); ++k) index.emplace(from.frames[k].image, k);
    initial_ = identity_ppisp(int(scene_.train.size()), scene_.num_cameras);
    std::vector<std::string> missing;
    for (std::size_t k = 0; k < scene_.train.size(); ++k) {
        const auto found = index.find(scene_.train[k].name);
        if (found == index.end()) {
            missing.push_back(scene_.train[k].name);
            continue;
        }
        std::copy_n(from.state.param.begin() + std::ptrdiff_t(found->second) * kIspFrameValues, kIspFrameValues,
                    initial_.param.begin() + std::ptrdiff_t(k) * kIspFrameValues);
    }
    if (!missing.empty()) {
        std::string names;
        for (std::size_t k = 0; k < std::min(kNamed, missing.size()); ++k) names += (k ? ", " : "") + missing[k];
        throw DataError(fmt::format("{}: no values for {} of {} training images: {}{}", path.string(), missing.size(),
                                    scene_.train.size(), names, missing.size() > kNamed ? ", ..." : ""));
    }
    std::copy(from.state.param.begin() + std::ptrdiff_t(from.state.camera_offset(0)), from.state.param.end(),
              initial_.param.begin() + std::ptrdiff_t(initial_.camera_offset(0)));
    initial_.controller = std::move(from.state.controller);
    file_.mean_exif = from.mean_exif;  // the value used to train the controller
    frozen_ = true;
}

void Photometric::resume(Gaussians& state, const ScheduleMoment& moment) {
    const PpispState& held = state.ppisp;
    if (held.active()) {
        if (options_.ppisp == PpispMode::kOff)
            throw UsageError(
                "option ppisp: the checkpoint was trained with PPISP, so the run cannot continue with it off");
        if (held.num_frames != int(scene_.train.size()) || held.num_cameras != scene_.num_cameras)
            throw DataError(
                fmt::format("the checkpoint corrects {} images of {} cameras, but the scene has {} training images of "
                            "{}; is it another scene or split?",
                            held.num_frames, held.num_cameras, scene_.train.size(), scene_.num_cameras));
        active_ = true;
        first_ = moment.position - double(held.step) * moment.position / std::max(1.0, double(moment.iteration));
        return;
    }
    state.ppisp = initial_;
    first_ = moment.position;
}

bool Photometric::holds_view_dependence(Backend& backend, const ScheduleMoment& moment) {
    if (!active_ || frozen_ || moment.position >= longest_hold_) return false;
    const double spread = exposure_spread(backend.download_ppisp());
    const bool hold = spread > kSpreadThatHolds;
    if (hold && !held_)
        log_info("exposures differ by {:.2f} stops: colours will not depend on the view in the first third", spread);
    held_ = hold;
    return hold;
}

void Photometric::apply(std::size_t view, const ScheduleMoment& moment, StepRequest& request) const {
    if (!active_) return;
    request.isp = {.mode = IspMode::kFrame,
                   .frame = int(view),
                   .camera = scene_.train[view].camera_id,
                   .prior_exposure = prior(view)};
    request.rates.isp = frozen_ ? 0 : ppisp_rate(options_.ppisp_lr, moment.position - first_);
}

void Photometric::add_controllers(Backend& backend) const {
    PpispState state = backend.download_ppisp();
    initialize_controller(state, seed_);
    backend.upload_ppisp(state);
}

void Photometric::apply_controller(std::size_t view, StepRequest& request) const {
    request.isp = {.mode = IspMode::kController,
                   .frame = int(view),
                   .camera = scene_.train[view].camera_id,
                   .prior_exposure = prior(view)};
    request.rates.isp = kControllerRate;
}

void Photometric::report(Backend& backend) const {
    if (!active_) return;
    const PpispState state = backend.download_ppisp();
    double n = 0, mean_a = 0, mean_b = 0, ab = 0, aa = 0, bb = 0;
    for (std::size_t k = 0; k < file_.frames.size(); ++k) {
        if (!file_.frames[k].exif_exposure) continue;
        const double a = state.param[k * kIspFrameValues] - mean_a, b = *file_.frames[k].exif_exposure - mean_b;
        mean_a += a / ++n, mean_b += b / n;
        const double after_a = state.param[k * kIspFrameValues] - mean_a,
                     after_b = *file_.frames[k].exif_exposure - mean_b;
        ab += a * after_b, aa += a * after_a, bb += b * after_b;
    }
    if (aa > 0 && bb > 0)
        log_info("exposures of {:.0f} images against EXIF: correlation {:.4f}, slope {:.3f}", n,
                 ab / std::sqrt(aa * bb), ab / bb);
}

void Photometric::save(const std::filesystem::path& path, Backend& backend, std::int64_t iteration) const {
    if (!active_) return;
    PpispFile file = file_;
    file.iteration = iteration;
    file.state = backend.download_ppisp();
    write_ppisp_json(path, file);
}

}  // namespace gs
