// SPDX-License-Identifier: Apache-2.0
// Compares a scene with the list of views in a run, and collects the options that determine the trained model, as
// texts.
#include "eval/runs/run_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/options.h"
#include "lib/core/run_config.h"
#include "lib/model/cameras_json.h"
#include "lib/model/run_folder.h"
#include "lib/scene/frame.h"
#include "lib/scene/resized.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Largest camera difference due to rounding, relative to the size of the quantity: text files may have only six
/// digits. A tenth of a pixel for an image 1000 pixels wide.
constexpr double kTolerance = 1e-4;
/// Largest rounding of a position far from the origin, relative to its distance from the origin: single precision.
constexpr double kFarTolerance = 1e-7;

std::string place_of(const std::string& source) {
    TrainOptions options;
    options.source = source;
    return training_options(options).at("source");
}

std::vector<ListedView> views_of(const Scene& scene) {
    std::vector<ListedView> views;
    for (const auto* list : {&scene.test, &scene.train})
        for (const View& view : *list)
            views.push_back({view.name, list == &scene.test, out_of_frame(view.camera, scene.frame)});
    return views;
}

void sort_by_name(std::vector<ListedView>& views) {
    std::sort(views.begin(), views.end(), [](const ListedView& a, const ListedView& b) {
        return std::pair(a.name, a.is_test) < std::pair(b.name, b.is_test);
    });
}

/// Returns the largest distance of a camera from the mean of all cameras.
double extent_of(const std::vector<ListedView>& views) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const ListedView& view : views) mean += view.camera.center() / double(views.size());
    double extent = 0;
    for (const ListedView& view : views) extent = std::max(extent, (view.camera.center() - mean).norm());
    return extent;
}

/// Returns the first name in `views` that is missing from `others`, both sorted; empty if there is none.
std::string first_without(const std::vector<ListedView>& views, const std::vector<ListedView>& others) {
    std::vector<ListedView> rest;
    std::set_difference(views.begin(), views.end(), others.begin(), others.end(), std::back_inserter(rest),
                        [](const ListedView& a, const ListedView& b) { return a.name < b.name; });
    return rest.empty() ? "" : rest.front().name;
}

std::string difference_in_names(const std::vector<ListedView>& own, const std::vector<ListedView>& now) {
    const std::string added = first_without(now, own), missing = first_without(own, now);
    std::string text = own.size() == now.size()
                           ? "it has other images"
                           : fmt::format("it has {} images, and the run has {}", now.size(), own.size());
    if (!missing.empty()) text += fmt::format("; '{}' is missing", missing);
    if (!added.empty()) text += fmt::format("; '{}' is not of the run", added);
    return text;
}

/// Describes how two cameras of one image differ; empty if only by rounding. Without `same_size` only poses count.
std::string difference_of_cameras(const Camera& own, const Camera& now, double extent, bool same_size) {
    const auto near = [](double a, double b, double size) { return std::abs(a - b) <= kTolerance * size; };
    if (same_size && !(near(own.fx, now.fx, own.fx) && near(own.fy, now.fy, own.fy)))
        return fmt::format("has focal lengths of {:.6g} and {:.6g} pixels, and {:.6g} and {:.6g} in the run", now.fx,
                           now.fy, own.fx, own.fy);
    if (same_size && !(near(own.cx, now.cx, own.width) && near(own.cy, now.cy, own.height)))
        return fmt::format("has its principal point at ({:.6g}, {:.6g}), and at ({:.6g}, {:.6g}) in the run", now.cx,
                           now.cy, own.cx, own.cy);
    if (!((own.rotation - now.rotation).norm() <= kTolerance)) return "looks in another direction than in the run";
    const double distance = (own.center() - now.center()).norm();
    if (!(distance <= kTolerance * extent + kFarTolerance * own.center().norm() + 1e-9))
        return fmt::format("stands {:.4g} units from where it stands in the run", distance);
    return "";
}

void require_scene_exists(const fs::path& run_folder, const TrainOptions& options) {
    if (scene_exists(options.source) || !path_exists(RunFolder{run_folder}.config())) return;
    // The user gave this source: load_scene reports the error.
    if (load_run_options(run_folder).source != options.source) return;
    throw DataError(
        fmt::format("'{}': its scene '{}' is not there any more, and not at the same place relative to the run either; "
                    "name where it is now with -s SCENE",
                    run_folder.string(), options.source));
}

/// Gives the views of the run's own scene the cameras that the run learned, if it did.
void set_refined_cameras(const fs::path& run_folder, Scene& scene) {
    std::map<std::string, Camera> refined;
    for (const ListedView& view : read_cameras_json(RunFolder{run_folder}.cameras()))
        if (view.refined) refined[view.name] = *view.refined;
    for (auto* views : {&scene.train, &scene.test})
        for (View& view : *views) {
            const auto found = refined.find(view.name);
            if (found == refined.end()) continue;
            Camera camera = resized(into_frame(found->second, scene.frame), view.camera.width, view.camera.height);
            camera.range = view.camera.range;
            view.given = std::make_shared<const Camera>(std::exchange(view.camera, camera));
        }
}

}  // namespace

std::map<std::string, std::string> training_options(const TrainOptions& named) {
    const TrainOptions options = with_absolute_paths(named);
    std::map<std::string, std::string> texts;
    for (const Option& option : train_option_table())
        if (option.scope == Scope::kExperiment || option.scope == Scope::kScene)
            texts[option.key] = option_text(option, options);
    const bool builtin = options.source.starts_with("builtin:");
    std::error_code error;
    const auto resolved = std::filesystem::weakly_canonical(options.source, error);
    texts["source"] = builtin || error ? options.source : resolved.string();
    return texts;
}

std::string difference_to_scene(const fs::path& run_folder, const TrainOptions& options, const Scene& scene) {
    std::vector<ListedView> own = read_cameras_json(RunFolder{run_folder}.cameras()), now = views_of(scene);
    if (own.empty()) return "";
    const TrainOptions run = load_run_options(run_folder);
    const std::string before = place_of(run.source), place = place_of(options.source);
    // Built-in scenes may share their cameras but have different content.
    if (before != place && (before.starts_with("builtin:") || place.starts_with("builtin:")))
        return fmt::format("the run has {}", run.source);
    sort_by_name(own), sort_by_name(now);
    if (!std::equal(own.begin(), own.end(), now.begin(), now.end(),
                    [](const ListedView& a, const ListedView& b) { return a.name == b.name; }))
        return difference_in_names(own, now);
    const bool same_split = options.eval == run.eval && options.test_every == run.test_every &&
                            absolute_path(options.test_list) == absolute_path(run.test_list);
    const bool same_size = options.images == run.images && options.resolution == run.resolution;
    for (std::size_t k = 0; k < own.size(); ++k) {
        if (same_split && own[k].is_test != now[k].is_test)
            return fmt::format("'{}' is a {} view, and a {} view of the run", now[k].name,
                               now[k].is_test ? "test" : "training", own[k].is_test ? "test" : "training");
        const Camera &a = own[k].camera, &b = now[k].camera;
        if (same_size && (a.width != b.width || a.height != b.height))
            return fmt::format("'{}' has {}x{} pixels, and {}x{} in the run", now[k].name, b.width, b.height, a.width,
                               a.height);
    }
    const double extent = extent_of(own);
    for (std::size_t k = 0; k < own.size(); ++k)
        if (const std::string text = difference_of_cameras(own[k].camera, now[k].camera, extent, same_size);
            !text.empty())
            return fmt::format("the camera of '{}' {}", now[k].name, text);
    return "";
}

void require_run_scene(const fs::path& run_folder, const TrainOptions& options, const Scene& scene) {
    const std::string difference = difference_to_scene(run_folder, options, scene);
    if (difference.empty()) return;
    throw DataError(
        fmt::format("{}: is not the scene that '{}' was trained on: {}. Name that scene with -s SCENE, or restore it; "
                    "another scene needs a run of its own (gsapp eval RUN -s SCENE scores on it, apart from the run)",
                    options.source, run_folder.string(), difference));
}

Scene load_run_scene(const fs::path& run_folder, const TrainOptions& options, const LoadRules& rules) {
    require_scene_exists(run_folder, options);
    Scene scene = load_scene(options, rules);
    require_run_scene(run_folder, options, scene);
    set_refined_cameras(run_folder, scene);
    return scene;
}

bool is_other_scene(const fs::path& run_folder, const TrainOptions& options, const Scene& scene) {
    const std::string own = load_run_options(run_folder).source;
    if (scene_exists(own)) return place_of(own) != place_of(options.source);
    return read_cameras_json(RunFolder{run_folder}.cameras()).empty() ||
           !difference_to_scene(run_folder, options, scene).empty();
}

}  // namespace gs
