// SPDX-License-Identifier: Apache-2.0
// gsapp render: renders images and videos of a finished run or a point cloud from the scene's cameras, a camera file,
// or an orbit.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <list>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "apps/gsapp/arguments.h"
#include "apps/gsapp/command.h"
#include "apps/gsapp/printing.h"
#include "apps/gsapp/render/camera_path.h"
#include "apps/gsapp/render/false_colors.h"
#include "apps/gsapp/render/frame_folder.h"
#include "apps/gsapp/render/orbit.h"
#include "apps/gsapp/render/render_views.h"
#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/model/model_file.h"
#include "lib/scene/resized.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr double kUsualFps = 30;

/// Largest field of view of a fisheye picture, degrees.
constexpr double kMostFov = 350;

struct RenderArguments {
    std::string run, views = "test", path, output, ppisp_eval, show = "picture", size, video, orbit_radius,
                     orbit_target, orbit_up, lens;
    double lens_fov = 180;
    std::shared_ptr<SceneArguments> scene;
    int orbit = 0;
    int ranks = 1;
    double orbit_elevation = 0, fps = kUsualFps;
    std::int64_t iteration = -1;  ///< -1 = the last saved iteration
    RenderParts parts;
    bool skip_train = false, skip_test = false;  ///< alternative names of 3DGS for --views
    bool overwrite = false, has_elevation = false, has_fps = false, json = false;
};

/// Views for one folder.
struct ViewSet {
    std::string name;  ///< name of the folder, unless the user gives one
    std::vector<View> views;
};

struct WantedViews {
    std::vector<ViewSet> sets;
    std::optional<double> fps;  ///< frame rate of the camera file
};

OrbitShape orbit_shape(const RenderArguments& arguments) {
    OrbitShape shape;
    shape.count = arguments.orbit;
    if (!arguments.orbit_radius.empty()) shape.radius = parse_orbit_radius(arguments.orbit_radius);
    if (!arguments.orbit_target.empty()) shape.target = parse_orbit_target(arguments.orbit_target);
    if (arguments.has_elevation) shape.elevation = arguments.orbit_elevation;
    if (!arguments.orbit_up.empty()) shape.up = parse_axis(arguments.orbit_up);
    return shape;
}

WantedViews wanted_views(const RenderArguments& arguments, const SavedRun& run) {
    const Scene& scene = run.scene;
    if (!arguments.path.empty()) {
        const CameraPath path = read_camera_path(arguments.path, scene.frame);
        return {{{"path", views_of(path.cameras)}}, path.fps};
    }
    if (arguments.orbit > 0) {
        OrbitShape shape = orbit_shape(arguments);
        std::vector<View> views = scene.train;
        if (run.options.source.empty()) views = {usual_view(run.backend->download(false), shape, scene.frame)};
        return {{{"orbit", views_of(orbit_path(views, shape, scene.frame))}}, {}};
    }
    WantedViews wanted;
    for (const char* which : {"test", "train"})
        if ((arguments.views == which || arguments.views == "all") && !views_of(scene, which).empty())
            wanted.sets.push_back({which, views_of(scene, which)});
    if (wanted.sets.empty())
        throw UsageError(
            fmt::format("{} has no {} views; --eval holds some out when training", arguments.run, arguments.views));
    return wanted;
}

double horizontal_degrees(const Camera& camera) {
    return 360 / std::numbers::pi * std::atan(0.5 * camera.width / camera.fx);
}

void resize_views(std::vector<ViewSet>& sets, const PictureSize& size) {
    const Camera before = sets[0].views[0].camera;
    for (ViewSet& set : sets)
        for (View& view : set.views) view.camera = with_vertical_field(view.camera, size);
    if (!is_pinhole(before)) return;
    log_info(
        "pictures of {}x{} pixels: the vertical field of view stays, the horizontal one goes from {:.1f} to {:.1f} "
        "degrees",
        size.width, size.height, horizontal_degrees(before), horizontal_degrees(sets[0].views[0].camera));
}

/// Puts a lens before all cameras: "pinhole", "fisheye" (equidistant, lens_fov degrees across the width) or
/// "equirectangular".
void set_lens(std::vector<ViewSet>& sets, const RenderArguments& arguments, const std::optional<PictureSize>& size) {
    LensCamera lens;
    if (arguments.lens == "equirectangular") {
        const PictureSize s = size.value_or(PictureSize{2048, 1024});
        lens = make_lens_camera(CameraModel::kEquirectangular, s.width, s.height,
                                std::array{double(s.width), double(s.height)});
    } else if (arguments.lens == "fisheye") {
        const PictureSize s = size.value_or(PictureSize{1024, 1024});
        const double focal = s.width / (arguments.lens_fov * std::numbers::pi / 180);
        lens = make_lens_camera(CameraModel::kSimpleFisheye, s.width, s.height,
                                std::array{focal, 0.5 * s.width, 0.5 * s.height});
    }
    const LensRange range = lens_range(lens);
    for (ViewSet& set : sets)
        for (View& view : set.views) {
            Camera& camera = view.camera;
            if (arguments.lens == "pinhole") {
                camera = without_lens(camera);
                if (size) camera = with_vertical_field(camera, *size);
                continue;
            }
            static_cast<LensCamera&>(camera) = lens;
            camera.range = range;
        }
}

/// Sets views of several sizes, which cannot form a video, to the most frequent size, rounded down to even numbers; if
/// several are equally frequent, to the largest of them.
void unite_sizes(std::vector<ViewSet>& sets) {
    std::map<std::pair<int, int>, std::size_t> counts;
    for (const View& view : sets[0].views) ++counts[{view.camera.width, view.camera.height}];
    if (counts.size() == 1) return;
    const auto [size, count] = *std::max_element(counts.begin(), counts.end(), [](const auto& a, const auto& b) {
        const auto rank = [](const auto& one) {
            return std::pair(one.second, std::int64_t(one.first.first) * one.first.second);
        };
        return rank(a) < rank(b);
    });
    log_info(
        "the views have {} sizes and a video has one: all get that of {} of them, in even numbers (--size names "
        "another)",
        counts.size(), count);
    const auto even = [](int side) { return std::max(2, side / 2 * 2); };
    resize_views(sets, {even(size.first), even(size.second)});
}

/// Returns the folder for the images of a set. If the user gives a folder, it contains the images directly, or in a
/// subfolder per set if there are several.
fs::path folder_of(const RenderArguments& arguments, const SavedRun& run, const std::string& set) {
    if (arguments.output.empty()) return run.folder / "renders" / fmt::format("iteration_{}", run.iteration) / set;
    const fs::path folder = arguments.output;
    return arguments.views == "all" ? folder / set : folder;
}

/// Writes the images, and returns their location; null in a rank that only holds rows.
nlohmann::ordered_json run_render(const RenderArguments& arguments) {
    if (!arguments.video.empty() && arguments.views == "all")
        throw UsageError("--video makes a video of one folder: name --views test or --views train");
    if (arguments.show == "appearance" && arguments.parts.decompose)
        throw UsageError("--show appearance has one colour a Gaussian; it has no --decompose");
    const std::optional<PictureSize> size =
        arguments.size.empty() ? std::nullopt : std::optional(parse_picture_size(arguments.size));
    orbit_shape(arguments);  // reports errors before the scene is read
    require_model_file(arguments.run);
    if (arguments.output.empty() && is_point_cloud(arguments.run))
        throw UsageError(fmt::format(
            "'{}' is a point cloud, which has no run folder for the pictures: name a folder with --output DIR",
            arguments.run));
    RunChanges changes = arguments.scene->changes({arguments.run});
    const auto group = join_ranks(arguments.ranks, "render", arguments.run);
    if (group && group->rank() > 0) {
        follow_command(*group, started_as("render"));
        return nullptr;
    }
    changes.group = group.get();
    // The colours of --show appearance are computed from the training cameras.
    changes.needs_scene = (arguments.path.empty() && arguments.orbit == 0) || arguments.show == "appearance";
    SavedRun run = open_saved_run(arguments.run,
                                  arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration), changes);
    catch_interrupts();  // from here on, so that unfinished images are removed
    WantedViews wanted = wanted_views(arguments, run);
    if (!arguments.lens.empty())
        set_lens(wanted.sets, arguments, size);
    else if (size)
        resize_views(wanted.sets, *size);
    else if (!arguments.video.empty())
        unite_sizes(wanted.sets);
    if (!arguments.video.empty()) require_video(arguments.video, wanted.sets[0].views);

    EvalCorrection correction = run.correction;
    correction.mode = choose_correction(arguments.ppisp_eval, run.correction.mode);
    if (arguments.show == "appearance") {
        run.backend->upload(appearance_colors(run.backend->download(false), run.scene.train));
        run.background = {0, 0, 0};
    }
    std::list<FrameFolder> folders;
    for (const ViewSet& set : wanted.sets)
        folders.emplace_back(folder_of(arguments, run, set.name), render_files(arguments.parts, set.views.size()),
                             arguments.overwrite);
    auto folder = folders.begin();
    for (const ViewSet& set : wanted.sets)
        render_views(run, set.views, correction, arguments.parts, (folder++)->path());
    folder = folders.begin();
    nlohmann::ordered_json written = {{"folders", nlohmann::ordered_json::array()}, {"video", nullptr}};
    for (const ViewSet& set : wanted.sets) {
        folder->commit();
        log_info("{} pictures in {}", set.views.size(), folder->folder().string());
        written["folders"].push_back({{"folder", (folder++)->folder().string()}, {"pictures", set.views.size()}});
    }
    if (arguments.video.empty()) return written;
    const double fps = arguments.has_fps ? arguments.fps : wanted.fps.value_or(kUsualFps);
    make_video(arguments.video, picture_folder(folders.front().folder(), arguments.parts), wanted.sets[0].views.size(),
               fps);
    log_info("video of {:.1f} s in {}", double(wanted.sets[0].views.size()) / fps, arguments.video);
    written["video"] = arguments.video;
    return written;
}

void add_camera_options(CLI::App& command, RenderArguments& arguments) {
    CLI::Option* views = command.add_option("--views", arguments.views, "Cameras of the scene: test, train or all")
                             ->capture_default_str();
    views->check(CLI::IsMember({"test", "train", "all"}));
    // Names from 3DGS's render.py.
    command.add_flag("--skip_train,--skip-train", arguments.skip_train)->group("");
    command.add_flag("--skip_test,--skip-test", arguments.skip_test)->group("");
    CLI::Option* path =
        command
            .add_option("--path", arguments.path,
                        "File of cameras: a list as in cameras.json, nerfstudio's camera_path.json, or a "
                        "transforms.json")
            ->excludes(views);
    CLI::Option* orbit =
        command.add_option("--orbit", arguments.orbit, "That many cameras on a circle around the scene")
            ->check(CLI::Range(1, 1000000))
            ->excludes(views)
            ->excludes(path);
    command
        .add_option("--orbit-radius", arguments.orbit_radius,
                    "Distance of the orbit's cameras from their target: 2.5 in scene units, or 1.5x the usual one "
                    "(default: the training cameras' mean)")
        ->needs(orbit)
        ->group("Orbit");
    command
        .add_option("--orbit-elevation", arguments.orbit_elevation,
                    "Height of the orbit's cameras as seen from their target, in degrees; 0 is level with it (default: "
                    "the training cameras' mean)")
        ->check(CLI::Range(-89.0, 89.0))
        ->needs(orbit)
        ->each([&](const std::string&) { arguments.has_elevation = true; })
        ->group("Orbit");
    command
        .add_option("--orbit-target", arguments.orbit_target,
                    "Point X,Y,Z that the orbit's cameras look at, in scene coordinates (default: where the training "
                    "cameras look)")
        ->needs(orbit)
        ->group("Orbit");
    command
        .add_option("--orbit-up", arguments.orbit_up,
                    "Axis of the scene that points up in the orbit: x, y, z, -x, -y or -z (default: as the training "
                    "cameras were held; without a scene -y, as most .ply files have it)")
        ->check(CLI::IsMember({"x", "y", "z", "-x", "-y", "-z"}))
        ->needs(orbit)
        ->group("Orbit");
    command.add_option("--size", arguments.size,
                       "Size of the pictures, WIDTHxHEIGHT; the vertical field of view stays, so wider pictures show "
                       "more at the sides (default: the cameras' own)");
    CLI::Option* lens =
        command
            .add_option(
                "--lens", arguments.lens,
                "Lens of the pictures: pinhole, fisheye (equidistant, 1024x1024 unless --size says otherwise) or "
                "equirectangular (360 degrees, 2048x1024; default: the cameras' own)")
            ->check(CLI::IsMember({"pinhole", "fisheye", "equirectangular"}));
    command.add_option("--lens-fov", arguments.lens_fov, "Degrees that a fisheye picture shows across its width")
        ->check(CLI::Range(1.0, kMostFov))
        ->needs(lens)
        ->capture_default_str();
}

void add_picture_options(CLI::App& command, RenderArguments& arguments) {
    command.add_flag(
        "--decompose", arguments.parts.decompose,
        "Also write the base colour without view dependence, and the residual; OUTPUT/{full,base,residual}");
    command.add_flag(
        "--depth", arguments.parts.depth,
        "Also write the expected depth; sum(w z)/sum(w) along the camera's axis, in scene units, as OpenEXR "
        "and in colours: OUTPUT/depth. It is a mean: at edges it lies between the surfaces");
    command.add_flag(
        "--median-depth", arguments.parts.median_depth,
        "Also write the median depth; that of the Gaussian at which half of the light is gone, in the same "
        "way: OUTPUT/median_depth. At edges it lies on one of the surfaces; 0 where alpha is below 1/2");
    command.add_flag("--normals", arguments.parts.normals,
                     "Also write normals; the Gaussians' shortest axes turned to the camera, in the scene's axes, as "
                     "OpenEXR and in colours: OUTPUT/normals");
    command.add_flag("--alpha", arguments.parts.alpha,
                     "Also write 1 - transmittance as OpenEXR and in grey: OUTPUT/alpha");
    command
        .add_option(
            "--show", arguments.show,
            "picture; or appearance: grey if a Gaussian has one colour from everywhere, else from blue to yellow "
            "by how much its colour depends on the view")
        ->capture_default_str()
        ->check(CLI::IsMember({"picture", "appearance"}));
    CLI::Option* video = command.add_option("--video", arguments.video,
                                            "Also make a video of the pictures, FILE.mp4 or FILE.webm; needs ffmpeg");
    command.add_option("--fps", arguments.fps, "Pictures a second in the video (default: what --path says, else 30)")
        ->check(CLI::Range(kLeastFps, kMostFps))
        ->needs(video)
        ->each([&](const std::string&) { arguments.has_fps = true; });
}

}  // namespace

void add_render_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<RenderArguments>();
    CLI::App* command = app.add_subcommand("render", "Write pictures and videos of a finished run, or of a .ply file");
    command
        ->add_option("run,-m,--model,--model_path", arguments->run,
                     "Run folder, or .ply file, which needs --output, and for --views also --source")
        ->required()
        ->type_name("RUN|FILE.ply");
    command
        ->add_option("--ppisp-eval", arguments->ppisp_eval,
                     "Photometric correction: controller (default if the model has one), or none = neutral exposure "
                     "and colour")
        ->check(CLI::IsMember({"controller", "none"}));
    add_camera_options(*command, *arguments);
    command->add_option("--iteration", arguments->iteration, "Saved iteration to render (default: the last)")
        ->check(CLI::Range(std::int64_t(-1), std::numeric_limits<std::int64_t>::max()));
    command->add_option("-o,--output", arguments->output,
                        "Folder for the pictures (default: test, train, orbit or path in RUN/renders/iteration_N)");
    command->add_flag("--overwrite", arguments->overwrite,
                      "Replace the pictures of an earlier call; those that would stay beside the new ones are removed");
    add_picture_options(*command, *arguments);
    arguments->scene = std::make_shared<SceneArguments>(
        *command,
        "Scene whose views are rendered; for a .ply file, unless --orbit or --path is given, and for a run whose scene "
        "was moved since the training",
        DeviceOption::kDeclared);
    add_ranks_option(*command, arguments->ranks);
    add_outcome_flag(*command, arguments->json);
    add_quiet_flag(*command);
    command->callback([arguments, command, &selected] {
        if (arguments->skip_train && arguments->skip_test)
            throw UsageError("--skip_train and --skip_test together leave no views");
        if ((arguments->skip_train || arguments->skip_test) && command->get_option("--views")->count() > 0)
            throw UsageError("--views names the views; leave --skip_train or --skip_test out");
        if (arguments->skip_test) arguments->views = "train";
        selected = [arguments] {
            const nlohmann::ordered_json written = run_render(*arguments);
            if (arguments->json && !written.is_null()) print_json(written);
        };
    });
}

}  // namespace gs
