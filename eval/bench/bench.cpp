// SPDX-License-Identifier: Apache-2.0
// Times steps and frames over decoded views, and writes the measurements as text and JSON.
#include "eval/bench/bench.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "kernels/base/clock.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/core/version.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/initialize.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/resized.h"
#include "lib/train/run_costs.h"
#include "lib/train/step_composer.h"

namespace gs {
namespace {

/// Largest number of views: enough to average over, few enough for their images to fit in memory.
constexpr std::size_t kMaxViews = 64;

/// Takes training steps over decoded views, one after another.
class Steps {
  public:
    Steps(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model, int repeat)
        : backend_(backend),
          composer_(options, model.appearance, scene, nullptr, kFrozenRates),
          background_(options.background.color) {
        const std::size_t all = scene.train.size(), used = std::min({all, kMaxViews, std::size_t(repeat)});
        for (std::size_t k = 0; k < used; ++k) {
            views_.push_back(k * all / used);  // spread over the scene
            images_.push_back(std::make_shared<const ViewImage>(scene.train[views_.back()].load()));
        }
        for (std::size_t k = 0; k < std::max<std::size_t>(2, used); ++k) step();
        backend_.synchronize();
    }

    void step() {
        const std::size_t k = next_++ % views_.size();
        backend_.step(
            composer_.compose({views_[k], images_[k], background_}, ScheduleMoment{iteration_, double(iteration_)}));
        ++iteration_;
    }

    /// Returns the mean time of `count` consecutive steps from the first view on, s, waiting only for the last step.
    double in_a_row(int count) {
        next_ = 0;
        const double start = seconds_now();
        for (int k = 0; k < count; ++k) step();
        backend_.synchronize();
        return (seconds_now() - start) / count;
    }

    /// Returns the median time of `count` steps, s, waiting for each.
    double median_alone(int count) {
        std::vector<double> times;
        for (int k = 0; k < count; ++k) {
            const double start = seconds_now();
            step();
            backend_.synchronize();
            times.push_back(seconds_now() - start);
        }
        std::nth_element(times.begin(), times.begin() + std::ptrdiff_t(times.size() / 2), times.end());
        return times[times.size() / 2];
    }

  private:
    Backend& backend_;
    const StepComposer composer_;
    const Vec3<float> background_;
    std::vector<std::size_t> views_;
    std::vector<std::shared_ptr<const ViewImage>> images_;
    std::int64_t iteration_ = 0;
    std::size_t next_ = 0;
};

/// Returns the costs of the stages per iteration.
std::vector<StageCost> measure_stages(Backend& backend, Steps& steps, int repeat) {
    for (int pass = 0; pass < backend.stage_passes(); ++pass) {
        backend.measure_stages(pass);
        if (pass == 0) {  // a device may have to prepare its timing marks
            steps.step();
            backend.synchronize();
            backend.measure_stages(pass);
        }
        steps.in_a_row(repeat);
    }
    std::vector<StageCost> stages = backend.measure_stages({});
    for (StageCost& s : stages)
        for (double* sum : {&s.seconds, &s.items, &s.bytes, &s.operations}) *sum /= repeat;
    return stages;
}

FrameTime time_frames(Backend& backend, const std::vector<Camera>& cameras, const Vec3<float>& background,
                      int repeats) {
    std::vector<RenderRequest> requests(cameras.size());
    for (std::size_t k = 0; k < cameras.size(); ++k)
        requests[k].camera = camera_params(cameras[k]), requests[k].background = background,
        requests[k].isp.mode = IspMode::kController;
    return {cameras[0].width, cameras[0].height, int(cameras.size()), backend.time_frames(requests, repeats)};
}

std::vector<FrameTime> time_all_frames(Backend& backend, const Scene& scene, const Vec3<float>& background,
                                       int repeats) {
    std::vector<Camera> own, resized;
    for (const View& view : scene.test.empty() ? scene.train : scene.test) {
        own.push_back(view.camera);
        resized.push_back(with_size(view.camera, kFrameWidth, kFrameHeight));
    }
    std::vector<FrameTime> frames = {time_frames(backend, own, background, repeats)};
    const auto same = [](const Camera& c) { return c.width == kFrameWidth && c.height == kFrameHeight; };
    if (!std::all_of(own.begin(), own.end(), same))
        frames.push_back(time_frames(backend, resized, background, repeats));
    return frames;
}

using Json = nlohmann::ordered_json;

/// Number of floors above which a stage needs a reason.
constexpr double kWellAboveFloor = 3;

TextTable frame_table(const BenchResult& r) {
    TextTable table{.title = {}, .header = {"frames", "ms/frame", "FPS"}, .num_labels = 1};
    for (const FrameTime& f : r.frames)
        table.lines.push_back({{fmt::format("{}x{}, {} views", f.width, f.height, f.num_views)},
                               {fmt::format("{:.3f}", 1e3 * f.seconds)},
                               {fmt::format("{:.1f}", f.seconds > 0 ? 1 / f.seconds : 0)}});
    return table;
}

std::string iteration_lines(const BenchResult& r) {
    double sum = 0;
    for (const StageCost& s : r.stages) sum += s.seconds;
    std::string out = fmt::format(
        "iteration at {}x{}: {:.3f} ms (mean of {} in a row), {:.3f} ms (median of {} that are each waited for)\n",
        r.width, r.height, 1e3 * r.iteration_seconds, r.repeat, 1e3 * r.iteration_seconds_median, r.repeat);
    out += fmt::format("the stages add up to {:.3f} ms\n", 1e3 * sum);
    if (r.default_seconds && r.deterministic_seconds)
        out += fmt::format("with --deterministic {:.3f} ms, without {:.3f} ms: {:.2f} times\n",
                           1e3 * *r.deterministic_seconds, 1e3 * *r.default_seconds,
                           *r.deterministic_seconds / *r.default_seconds);
    return out;
}

/// Lower bounds on a stage's time, in seconds.
struct Floor {
    double copy, fma;
    double seconds() const { return std::max(copy, fma); }
    const char* bound() const { return seconds() <= 0 ? "-" : copy > fma ? "copy" : "FMA"; }
};

Floor floor_of(const StageCost& s, const Ceilings& ceilings) {
    return {s.bytes / ceilings.copy_bytes_per_second, s.operations / ceilings.operations_per_second};
}

/// Returns the table of stages, with the reasons for slow ones below it.
std::string stage_text(const char* title, const std::vector<StageCost>& stages, const Ceilings& ceilings,
                       TableStyle style) {
    TextTable table{
        .title = {},
        .header = {title, "items are", "bound by", "ms", "M items", "ns per item", "floor ms", "measured/floor"},
        .num_labels = 3};
    std::string reasons;
    for (const StageCost& s : stages) {
        const Floor floor = floor_of(s, ceilings);
        const double ratio = floor.seconds() > 0 ? s.seconds / floor.seconds() : 0;
        const bool above = ratio > kWellAboveFloor;
        table.lines.push_back({{s.stage},
                               {s.item},
                               {floor.bound()},
                               {fmt::format("{:.3f}", 1e3 * s.seconds)},
                               {fmt::format("{:.3g}", s.items / 1e6)},
                               {fmt::format("{:.3f}", s.items > 0 ? 1e9 * s.seconds / s.items : 0)},
                               {fmt::format("{:.3f}", 1e3 * floor.seconds())},
                               {floor.seconds() > 0 ? fmt::format("{:.1f}", ratio) : "-", "", above ? 1 : 0}});
        if (above) reasons += fmt::format("- {}: {}\n", s.stage, s.note.empty() ? "no reason is known" : s.note);
    }
    std::string text = table_text(table, style);
    if (!reasons.empty()) text += fmt::format("\nAbove {:.0f} floors:\n\n{}", kWellAboveFloor, reasons);
    return text;
}

std::vector<StageCost> appearance_shares(const BenchResult& r) {
    std::vector<StageCost> shares;
    for (std::size_t k = 0; k < r.stages.size() && !r.without_residual.empty(); ++k)
        if (r.stages[k].evaluates_appearance) shares.push_back(appearance_share(r, k));
    return shares;
}

Json json_of(const std::vector<StageCost>& stages, const Ceilings& ceilings) {
    Json json = Json::array();
    for (const StageCost& s : stages) {
        const Floor floor = floor_of(s, ceilings);
        json.push_back({{"stage", s.stage},
                        {"seconds", s.seconds},
                        {"items", s.items},
                        {"item", s.item},
                        {"bytes", s.bytes},
                        {"operations", s.operations},
                        {"floor_seconds", floor.seconds()},
                        {"bound_by", floor.seconds() > 0 ? Json(floor.bound()) : Json()}});
        if (!s.note.empty()) json.back()["note"] = s.note;
    }
    return json;
}

Json json_of(const BenchResult& r) {
    Json json = {{"subject", r.subject},
                 {"device", r.device},
                 {"num_gaussians", r.num_gaussians},
                 {"copy_bytes_per_second", r.ceilings.copy_bytes_per_second},
                 {"operations_per_second", r.ceilings.operations_per_second},
                 {"frames", Json::array()}};
    for (const FrameTime& f : r.frames)
        json["frames"].push_back(
            {{"width", f.width}, {"height", f.height}, {"num_views", f.num_views}, {"seconds", f.seconds}});
    json["iteration"] = {{"width", r.width},
                         {"height", r.height},
                         {"repeat", r.repeat},
                         {"seconds", r.iteration_seconds},
                         {"median_seconds", r.iteration_seconds_median}};
    if (r.default_seconds && r.deterministic_seconds)
        json["iteration"].update(
            {{"default_seconds", *r.default_seconds}, {"deterministic_seconds", *r.deterministic_seconds}});
    json["stages"] = json_of(r.stages, r.ceilings);
    json["appearance"] = json_of(appearance_shares(r), r.ceilings);
    if (r.memory.peak > 0) json["device_memory"] = {{"bytes", r.memory.bytes}, {"peak_bytes", r.memory.peak}};
    return json;
}

}  // namespace

Gaussians initial_model(const TrainOptions& options, const Scene& scene) {
    const AppearanceSpec appearance = appearance_spec(options);
    Gaussians model = initialize_gaussians(scene, appearance, init_options(options));
    model.active_degree = appearance.max_degree;
    return model;
}

BenchResult run_bench(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                      const BenchOptions& bench) {
    BenchResult result;
    result.device = backend.describe();
    result.ceilings = backend.measure_ceilings();
    result.num_gaussians = model.count;
    result.width = scene.train.at(0).camera.width, result.height = scene.train[0].camera.height;
    result.repeat = bench.repeat;
    backend.upload(model);
    result.frames = time_all_frames(backend, scene, options.background.color, bench.frame_repeat);

    Steps steps(backend, options, scene, model, bench.repeat);
    result.iteration_seconds = steps.in_a_row(bench.repeat);
    result.iteration_seconds_median = steps.median_alone(bench.repeat);
    result.stages = measure_stages(backend, steps, bench.repeat);
    if (model.active_degree > 0 && model[Group::kResidual].width > 0) {
        backend.set_active_degree(0);
        result.without_residual = measure_stages(backend, steps, bench.repeat);
        backend.set_active_degree(model.active_degree);
    }
    result.memory = backend.memory();
    return result;
}

double frame_seconds(Backend& backend, const std::vector<View>& views, const Vec3<float>& background, int repeats) {
    std::vector<Camera> cameras;
    for (const View& view : views) cameras.push_back(view.camera);
    return time_frames(backend, cameras, background, repeats).seconds;
}

double iteration_seconds(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                         const BenchOptions& bench) {
    backend.upload(model);
    return Steps(backend, options, scene, model, bench.repeat).in_a_row(bench.repeat);
}

StageCost appearance_share(const BenchResult& result, std::size_t k) {
    StageCost share = result.stages[k];
    const StageCost& without = result.without_residual[k];
    share.seconds -= without.seconds, share.bytes -= without.bytes, share.operations -= without.operations;
    return share;
}

std::string format_bench(const BenchResult& r, TableStyle style) {
    std::string out =
        fmt::format("{}\n{}; {} Gaussians; copy {:.1f} GB/s, {:.0f} G single-precision FMA/s\n\n", r.subject, r.device,
                    r.num_gaussians, r.ceilings.copy_bytes_per_second / 1e9, r.ceilings.operations_per_second / 1e9);
    out += table_text(frame_table(r), style) + "\n" + iteration_lines(r) + "\n";
    out += stage_text("stage", r.stages, r.ceilings, style);
    if (const std::vector<StageCost> shares = appearance_shares(r); !shares.empty())
        out += "\n" + stage_text("appearance in", shares, r.ceilings, style);
    if (r.memory.peak > 0) out += "\n" + memory_report(r.memory) + "\n";
    return out;
}

std::string bench_json(const std::vector<BenchResult>& results) {
    Json json = {{"program", version_text()}, {"results", Json::array()}};
    for (const BenchResult& result : results) json["results"].push_back(json_of(result));
    return json_text(json, 1) + "\n";
}

}  // namespace gs
