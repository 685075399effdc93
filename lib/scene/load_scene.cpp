// SPDX-License-Identifier: Apache-2.0
// Recognises the type of a dataset, reads it, splits it and builds its views.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/log.h"
#include "lib/scene/camera_faults.h"
#include "lib/scene/colmap_reader.h"
#include "lib/scene/exif.h"
#include "lib/scene/frame.h"
#include "lib/scene/image_files.h"
#include "lib/scene/procedural.h"
#include "lib/scene/source_scene.h"
#include "lib/scene/split.h"
#include "lib/scene/view_builder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

void check_options(const SceneOptions& options) {
    const int r = options.resolution.value_or(1);
    // Other small numbers are mistyped divisors, not widths.
    if (r != 1 && r != 2 && r != 4 && r != 8 && r < 16)
        throw UsageError(fmt::format("resolution is {}; must be 1, 2, 4, 8 or a width of at least 16 pixels", r));
    if (options.test_every < 0)
        throw UsageError(fmt::format("test_every is {}; must be at least 0", options.test_every));
}

/// Throws DataError if a COLMAP model has only one of its two required files: the user meant it to be read.
void require_whole_model(const fs::path& source) {
    for (const fs::path& folder : {source / "sparse" / "0", source / "sparse", source})
        for (const char* form : {".bin", ".txt"}) {
            const fs::path cameras = folder / (std::string("cameras") + form),
                           images = folder / (std::string("images") + form);
            if (path_exists(cameras) == path_exists(images)) continue;
            const auto& [missing, present] =
                path_exists(cameras) ? std::pair(images, cameras) : std::pair(cameras, images);
            throw DataError(fmt::format("{}: is missing, and {} alone is no COLMAP model", missing.string(),
                                        present.filename().string()));
        }
}

SourceScene read_source(const fs::path& source, const SceneOptions& options) {
    if (!path_exists(source)) throw DataError(fmt::format("{}: no such folder or file", source.string()));
    if (!folder_exists(source)) return load_transforms(source, options);
    std::vector<std::string> notes;
    if (const fs::path model = find_colmap_model(source, notes); !model.empty()) {
        SourceScene scene = load_colmap(source, model, options);
        scene.notes.insert(scene.notes.begin(), notes.begin(), notes.end());
        return scene;
    }
    if (path_exists(source / "transforms_train.json")) return load_nerf_synthetic(source, options);
    if (path_exists(source / "transforms.json")) return load_transforms(source / "transforms.json", options);
    require_whole_model(source);
    throw DataError(fmt::format(
        "{}: not a scene: neither sparse/0/cameras.bin (or .txt) nor transforms_train.json nor transforms.json found; "
        "photographs alone need 'gsapp prepare' first",
        source.string()));
}

/// Marks the views named in a list file, one per line. A name that is no view's exact name matches approximately, by
/// the rules of find_images, if the match is unique. Throws DataError for an unreadable file or an unknown name.
std::vector<bool> read_test_list(const std::string& path, const std::vector<SourceView>& views) {
    if (const std::string fault = input_fault(path); !fault.empty())
        throw DataError(fmt::format("test list {}: cannot be read: {}", path, fault));
    std::vector<std::string> names;
    for (const SourceView& view : views) names.push_back(view.name);
    const NameIndex index(names);
    std::vector<bool> test(views.size());
    std::size_t number = 0, elsewhere = 0;
    std::string first;
    for (const std::string& line : read_name_list(path)) {
        ++number;
        if (line.empty()) continue;
        bool ambiguous = false;
        const std::optional<NameIndex::Match> match = index.find(line, ambiguous);
        if (!match)
            throw DataError(fmt::format("test list {}: line {}: {} '{}'", path, number,
                                        ambiguous ? "several images could be" : "no image is named", line));
        test[match->index] = true;
        if (!match->same_place && elsewhere++ == 0) first = fmt::format("'{}' is {}", line, names[match->index]);
    }
    if (elsewhere > 0)
        log_warning("test list {}: {} names were found by their ends (first: {})", path, elsewhere, first);
    return test;
}

/// Assigns each view to training, test or neither, and describes the rule in `rule`. Throws DataError if the dataset's
/// own split leaves no training view.
std::vector<ViewRole> choose_roles(const SourceScene& scene, const SceneOptions& options, std::string& rule) {
    std::vector<ViewRole> roles;
    for (const SourceView& view : scene.views) roles.push_back(view.role);
    const bool given = !scene.given_split.empty();
    const auto replace = [&](ViewRole role, ViewRole by) { std::replace(roles.begin(), roles.end(), role, by); };
    const auto trains = [&] { return std::find(roles.begin(), roles.end(), ViewRole::kTrain) != roles.end(); };
    if (!options.eval || !options.test_list.empty())
        replace(ViewRole::kTest, scene.test_views_train ? ViewRole::kTrain : ViewRole::kLeftOut);
    if (!options.eval) {
        rule = "all views train (no --eval)";
        if (given && scene.test_views_train)
            rule += "; the test views of " + scene.given_split + " train as well, as in 3DGS";
        else if (given)
            rule = fmt::format("no --eval; the views of {} are held out all the same", scene.given_split);
    } else if (!options.test_list.empty()) {
        const std::vector<bool> test = read_test_list(options.test_list, scene.views);
        for (std::size_t i = 0; i < roles.size(); ++i)
            if (test[i]) roles[i] = ViewRole::kTest;
        rule = "test views listed in " + fs::path(options.test_list).filename().string();
        if (given && !scene.test_views_train) rule += "; those of " + scene.given_split + " do not train either";
    } else if (given) {
        rule = "given: " + scene.given_split;
    } else if (options.test_every > 0) {
        int next = 0;
        for (ViewRole& role : roles)
            if (role == ViewRole::kTrain && next++ % options.test_every == 0) role = ViewRole::kTest;
        rule = fmt::format("sorted by name, index % {} == 0 is test", options.test_every);
    } else {
        rule = "all views train (--test-every 0)";
    }
    if (trains()) return roles;
    if (given) throw DataError(fmt::format("{}: {} leaves no view to train", options.source, scene.given_split));
    replace(ViewRole::kTest, ViewRole::kTrain);
    rule = fmt::format("all views train ({} would leave none to train)", rule);
    if (!trains()) throw DataError(fmt::format("{}: every view is left out", options.source));
    return roles;
}

/// Removes the views that are left out or cannot be read. With `scores` throws DataError if a test view cannot be read:
/// scores of the other views would not be comparable with scores of the whole set.
void remove_unused(SourceScene& scene, std::vector<ViewRole>& roles, bool scores) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < scene.views.size(); ++i) {
        if (roles[i] == ViewRole::kLeftOut) continue;
        if (!scene.views[i].unreadable.empty()) {
            if (roles[i] == ViewRole::kTest && scores)
                throw DataError(
                    fmt::format("test view {}: {}; scores without it would not be comparable: repair the "
                                "file, or take the view out of the scene",
                                scene.views[i].name, scene.views[i].unreadable));
            continue;
        }
        roles[kept] = roles[i];
        if (kept != i) scene.views[kept] = std::move(scene.views[i]);
        ++kept;
    }
    scene.views.resize(kept);
    roles.resize(kept);
}

/// Returns the camera centres of all views that the dataset does not leave out.
std::vector<Eigen::Vector3d> camera_centers(const std::vector<SourceView>& views) {
    std::vector<Eigen::Vector3d> centers;
    for (const SourceView& view : views)
        if (view.role != ViewRole::kLeftOut) centers.push_back(view.center());
    return centers;
}

/// Chooses the camera of each view: its lens, or a pinhole that replaces it. Leaves out the views for which there is
/// none, and throws DataError if no view remains.
void choose_cameras(SourceScene& scene, LensMode mode) {
    LensCamera lens;  // most scenes have one lens, whose borders are traced only once
    Camera camera;
    std::string fault, first;
    std::size_t usable = 0;
    const auto is_unusable = [&](SourceView& view) {
        if (!view.unreadable.empty()) return false;
        if (view.lens != lens) {
            lens = view.lens;
            fault.clear();
            try {
                camera = choose_camera(lens, mode, fmt::format("image '{}'", view.name));
            } catch (const DataError& error) {
                fault = error.what();
            }
        }
        view.camera = camera;
        usable += fault.empty();
        if (first.empty()) first = fault;
        return !fault.empty();
    };
    const std::size_t unusable = std::erase_if(scene.views, is_unusable);
    if (unusable == 0) return;
    if (usable == 0) throw DataError(first);
    scene.notes.push_back(
        fmt::format("{} images are left out because their camera cannot be used (first: {})", unusable, first));
}

/// Replaces the dataset's camera ids by indices of the devices that took training images.
void number_cameras(Scene& scene) {
    std::map<int, int> index;
    for (const View& view : scene.train) index.emplace(view.camera_id, 0);
    // If every photograph has its own camera, the photographs were calibrated one by one. They still come from one
    // device.
    const bool one_by_one = index.size() > 1 && index.size() == scene.train.size();
    scene.num_cameras = one_by_one ? 1 : int(index.size());
    int next = 0;
    for (auto& [id, number] : index) number = one_by_one ? 0 : next++;
    for (auto* views : {&scene.train, &scene.test}) {
        for (View& view : *views) {
            const auto found = index.find(view.camera_id);
            view.camera_id = found != index.end() ? found->second : one_by_one ? 0 : -1;
        }
    }
}

/// Sets the EXIF exposures. `roles` gives for each source view whether it became the next view of scene.test or of
/// scene.train.
void add_exposures(const std::vector<SourceView>& sources, const std::vector<ViewRole>& roles, Scene& scene) {
    std::vector<ExifSettings> settings;
    for (const SourceView& source : sources) settings.push_back(read_exif_settings(source.image_path));
    const std::vector<std::optional<double>> stops = exposure_stops(settings);
    std::size_t num_train = 0, num_test = 0, without = 0;
    for (std::size_t i = 0; i < sources.size(); ++i) {
        (roles[i] == ViewRole::kTest ? scene.test[num_test++] : scene.train[num_train++]).exif_exposure = stops[i];
        without += !stops[i];
    }
    if (without == sources.size())
        scene.notes.push_back("EXIF: no image has an exposure time");
    else if (without > 0)
        scene.notes.push_back(fmt::format(
            "EXIF: {} of {} images lack an exposure time, ISO or f-number that others have: mean exposure assumed",
            without, sources.size()));
}

/// Adds a line about the masks found, because they change the training without having been requested. Adds notes about
/// images without a mask, and about masks whose shape differs from their image's.
void describe_masks(const SourceScene& source, Scene& scene) {
    const std::size_t images = source.views.size();
    std::size_t masks = 0;
    std::vector<std::string> stretched;
    const SourceView* first = nullptr;
    for (const SourceView& view : source.views) {
        if (!view.mask) continue;
        ++masks;
        if (!first) first = &view;
        try {
            const ImageInfo mask = read_image_info(view.mask->path);
            // The sizes of smaller copies of masks and images are rounded. Some masks lie on their side, like the
            // stored image.
            const double width = double(view.info.width) / mask.width, height = double(view.info.height) / mask.height;
            const bool turned = view.turn != 1 || view.info.orientation != 1;
            if (std::abs(std::log(width / height)) > 0.05 && !turned)
                stretched.push_back(fmt::format("{} is {}x{}, {} {}x{}", view.mask->path.string(), mask.width,
                                                mask.height, view.name, view.info.width, view.info.height));
        } catch (const DataError&) {
            // Decoding the view reports the error.
        }
    }
    if (!first) return;
    scene.facts.push_back(
        fmt::format("masks: {} of {} images have one, the first is {}", masks, images, first->mask->path.string()));
    if (masks < images)
        scene.notes.push_back(fmt::format("{} of {} images have no mask: used whole", images - masks, images));
    if (!stretched.empty())
        scene.notes.push_back(fmt::format("{} masks have another shape than their images: stretched ({})",
                                          stretched.size(), listed(stretched)));
}

/// Returns the largest distance of a camera from the cameras' mean, or 0 if the cameras differ only by rounding.
double camera_radius(const std::vector<View>& views) {
    const Eigen::Vector3d mean = mean_camera_center(views);
    double radius = 0;
    for (const Eigen::Vector3d& center : usual_camera_centers(views)) radius = std::max(radius, (center - mean).norm());
    return radius > 1e-6 / 1.1 ? radius : 0;
}

/// Sets the cube in which a NeRF-synthetic scene is initialised, in scene units. The Blender scenes of this dataset
/// fill a cube of half side 1.5 around the origin, and their cameras are at a distance of 4.03 from it
/// (docs/math/optimization.md#first-gaussians). For a scene of this layout with other units or another origin, the cube
/// is scaled and placed at the point that the cameras look at.
void place_cube(Scene& scene) {
    constexpr double kHalfSide = 1.5, kDistance = 4.0311;
    scene.random_init_half_extent = kHalfSide;
    // Nearly parallel axes have no common point.
    if (!(mean_axis(scene.train).norm() < 0.99)) return;
    const Eigen::Vector3d target = common_target(scene.train);
    double distance = 0, ahead = 0;
    for (const View& view : scene.train) {
        const Eigen::Vector3d to_target = target - view.camera.center();
        distance += to_target.norm() / double(scene.train.size());
        ahead += view.camera.rotation.row(2).dot(to_target) / double(scene.train.size());
    }
    if (!(ahead > 0.5 * distance)) return;  // the axes of cameras that look away from each other meet behind them
    if (std::abs(distance / kDistance - 1) < 0.05 && target.norm() < 0.1 * kHalfSide) return;
    if (!(distance > 0) || !target.allFinite()) return;
    scene.random_init_center = target;
    scene.random_init_half_extent = kHalfSide / kDistance * distance;
}

/// Converts cameras, points and the initialisation cube from scene coordinates to frame coordinates.
void bring_into_frame(Scene& scene, const SourcePoints& points) {
    for (auto* views : {&scene.train, &scene.test})
        for (View& view : *views) {
            view.camera = into_frame(view.camera, scene.frame);
            for (PointObservation& seen : view.observations) seen.point = scene.frame.from_scene(seen.point);
        }
    scene.random_init_center = scene.frame.from_scene(scene.random_init_center);
    scene.random_init_half_extent *= scene.frame.scale;
    for (const Eigen::Vector3d& p : points.positions)
        scene.points.positions.push_back(scene.frame.from_scene(p).cast<float>());
    scene.points.colors = points.colors;
}

}  // namespace

std::shared_ptr<const ViewImage> view_image(const View& view) {
    auto image = view.decoded ? view.decoded : std::make_shared<const ViewImage>(view.load());
    const Camera& camera = view.camera;
    if (image->color.width != camera.width || image->color.height != camera.height)
        throw DataError(fmt::format("{}: the image has {}x{} pixels, its camera {}x{}", view.name, image->color.width,
                                    image->color.height, camera.width, camera.height));
    return image;
}

std::string view_digest(const std::vector<View>& views) {
    std::uint64_t hash = 0xcbf29ce484222325u;  // FNV-1a
    const auto add = [&](unsigned char byte) { hash = (hash ^ byte) * 0x100000001b3u; };
    for (const View& view : views) {
        for (const char c : view.name) add(static_cast<unsigned char>(c));
        add(0);
    }
    return fmt::format("{} {:016x}", views.size(), hash);
}

void remove_training_views(Scene& scene, const std::vector<bool>& unusable) {
    std::vector<View> usable;
    for (std::size_t i = 0; i < scene.train.size(); ++i)
        if (!unusable[i]) usable.push_back(std::move(scene.train[i]));
    scene.train = std::move(usable);
    number_cameras(scene);
    scene.extent = camera_extent(scene.train, scene.points);
}

std::vector<Eigen::Vector3d> usual_camera_centers(const std::vector<View>& views) {
    std::vector<Eigen::Vector3d> centers, usual;
    for (const View& view : views) centers.push_back(view.camera.center());
    const std::vector<bool> far = far_cameras(centers);
    for (std::size_t i = 0; i < centers.size(); ++i)
        if (!far[i]) usual.push_back(centers[i]);
    return usual;
}

Eigen::Vector3d mean_camera_center(const std::vector<View>& views) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    const std::vector<Eigen::Vector3d> centers = usual_camera_centers(views);
    for (const Eigen::Vector3d& center : centers) mean += center / double(centers.size());
    return mean;
}

double camera_extent(const std::vector<View>& views, const PointCloud& points) {
    if (views.empty()) return 1;
    const Eigen::Vector3d mean = mean_camera_center(views);
    const double radius = camera_radius(views);
    // A zero extent would freeze all positions. If the cameras are in one place, the points determine the size of the
    // scene.
    if (1.1 * radius > 1e-6) return 1.1 * radius;
    Eigen::Vector3d low = mean, high = mean;
    for (const Eigen::Vector3f& point : points.positions) {
        low = low.cwiseMin(point.cast<double>());
        high = high.cwiseMax(point.cast<double>());
    }
    return std::max(1e-2 * (high - low).norm(), 1e-6);
}

namespace {

constexpr std::string_view kBuiltin = "builtin:";

bool is_builtin(const std::string& source) { return source.starts_with(kBuiltin); }

/// Returns the folder of the scene, even if `source` names a file in it.
fs::path scene_folder(const std::string& source) {
    const fs::path path = canonical_path(source);
    return path_exists(path) && !folder_exists(path) ? path.parent_path() : path;
}

}  // namespace

Scene load_scene(const SceneOptions& options, const LoadRules& rules) {
    check_options(options);
    if (is_builtin(options.source)) {
        Scene scene = load_builtin_scene(options.source.substr(kBuiltin.size()), options);
        if (options.images != SceneOptions().images)
            scene.notes.push_back(
                fmt::format("--images {} is not used: {} has no image folders", options.images, options.source));
        return scene;
    }

    SourceScene source = read_source(options.source, options);
    Scene scene;
    scene.source = options.source;
    scene.kind = source.kind;
    scene.image_folder = source.image_folder;
    choose_cameras(source, options.lens);
    scene.frame = rules.frame ? *rules.frame : choose_frame(camera_centers(source.views), source.points.positions);
    scene.notes = std::move(source.notes);
    scene.facts = std::move(source.facts);
    if (!options.eval && !options.test_list.empty()) scene.notes.push_back("a test list without --eval: ignored");

    std::vector<ViewRole> roles = choose_roles(source, options, scene.split_rule);
    leave_out_wrong_poses(source.views, source.points, roles, scene.notes);
    remove_unused(source, roles, rules.scores);
    describe_masks(source, scene);
    ViewBuilder builder(options, source.prescaled);
    for (std::size_t i = 0; i < source.views.size(); ++i)
        (roles[i] == ViewRole::kTest ? scene.test : scene.train).push_back(builder.build(source.views[i]));
    if (source.is_object_in_cube) place_cube(scene);
    bring_into_frame(scene, source.points);
    for (std::string& line : builder.notes()) scene.notes.push_back(std::move(line));
    for (std::string& line : builder.facts()) scene.facts.push_back(std::move(line));
    number_cameras(scene);
    if (options.ppisp_exif) add_exposures(source.views, roles, scene);
    scene.has_alpha = builder.has_alpha();

    check_points(scene);
    scene.extent = camera_extent(scene.train, scene.points);
    if (scene.train.size() > 1 && camera_radius(scene.train) == 0)
        scene.notes.push_back(
            fmt::format("all {} cameras stand in one place: they do not tell the size of the scene, which is taken as "
                        "{:.3g} from its points; without parallax there is no depth to learn",
                        scene.train.size(), scene.extent / scene.frame.scale));
    return scene;
}

std::string scene_name(const std::string& source) {
    if (!is_builtin(source)) return scene_folder(source).filename().string();
    return fs::path(source.substr(kBuiltin.size())).stem().string();  // for builtin:FILE.yaml, the stem of the file
}

std::string dataset_name(const std::string& source) {
    return is_builtin(source) ? "builtin" : scene_folder(source).parent_path().filename().string();
}

}  // namespace gs
