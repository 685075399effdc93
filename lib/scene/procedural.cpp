// SPDX-License-Identifier: Apache-2.0
// Renders a procedural description into a Scene with views, initial points and extent.
#include "lib/scene/procedural.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "kernels/base/error.h"
#include "kernels/base/rng.h"
#include "lib/scene/procedural_description.h"
#include "lib/scene/view_builder.h"

namespace gs {
namespace {

using procedural::Description;

/// Applies `resolution` as for photographs: 1, 2, 4, 8 are divisors, larger values are the width in pixels, and -1
/// keeps the scene's own size.
void apply_resolution(procedural::CameraRig& rig, int resolution) {
    if (resolution == 1) return;
    const int width = rig.width;
    if (resolution == 2 || resolution == 4 || resolution == 8)
        rig.width = int(std::lround(double(width) / resolution));
    else if (resolution > 8)
        rig.width = resolution;
    else
        throw UsageError(fmt::format("resolution {} is neither 1, 2, 4, 8 nor a width above 8 pixels", resolution));
    rig.height = std::max(1, int(std::lround(double(rig.height) * rig.width / width)));
}

/// Applies the exposure and rounds to 8 bits as the evaluation protocol does.
Image photographed(const Image& in, const Description& description, const procedural::Photography& photography) {
    Image out{in.width, in.height, 3, {}, {}};
    out.u8.reserve(in.f32.size());
    for (int y = 0; y < in.height; ++y) {
        for (int x = 0; x < in.width; ++x) {
            const Eigen::Vector3d factor = procedural::exposure_factor(description, photography, x, y);
            for (int c = 0; c < 3; ++c)
                out.u8.push_back(std::uint8_t(std::clamp(in.value(x, y, c) * factor[c], 0.0, 1.0) * 255 + 0.5));
        }
    }
    return out;
}

/// Returns camera `index` of a set behind the lens or pinhole `lens`.
Camera posed(Camera lens, const Description& description, bool test, int index) {
    const Camera pose = procedural::rig_camera(description.cameras, test, index);
    lens.rotation = pose.rotation, lens.translation = pose.translation;
    return lens;
}

View make_view(const Description& description, const Camera& lens, bool test, int index) {
    View view;
    view.name = fmt::format("{}/{:03}.png", test ? "test" : "train", index);
    view.camera = posed(lens, description, test, index);
    const procedural::World world = test ? description.world : procedural::train_world(description, index);
    const procedural::Photography photography = procedural::photography(description, test, index);
    auto pixels = std::make_shared<const Image>(
        photographed(procedural::render(world, view.camera, description.pixel_grid), description, photography));
    view.image_bytes = pixels->bytes();
    view.lens_weights = is_pinhole(lens) ? nullptr : lens_weights(lens);
    view.load = [pixels, weights = view.lens_weights] {
        return ViewImage{*pixels, weights ? std::optional<Image>(*weights) : std::nullopt};
    };
    if (description.exposure) view.exif_exposure = photography.stops;
    return view;
}

/// Samples the surface points at random pixels of the training cameras, with their diffuse colour. Structure from
/// motion would give the same points, less exactly.
PointCloud sample_points(const Description& description, const Camera& lens) {
    PointCloud cloud;
    // Limited, because the loop would never end if the cameras saw no shape.
    const std::uint32_t attempts = 20u * std::uint32_t(description.points);
    for (std::uint32_t i = 0; i < attempts && cloud.positions.size() < std::size_t(description.points); ++i) {
        const Philox4 random = philox(0, RngStream::kScene, 1, i);
        const Camera camera = posed(lens, description, false, int(i % std::uint32_t(description.cameras.train)));
        const auto ray = procedural::camera_ray(camera, camera.width * uniform_from_bits<double>(random.v[0]),
                                                camera.height * uniform_from_bits<double>(random.v[1]));
        const auto hit = ray ? procedural::intersect(description.world, *ray) : std::nullopt;
        if (hit) {
            cloud.positions.push_back(hit->position.cast<float>());
            cloud.colors.push_back(
                procedural::shade(description.world, *hit, ray->direction).diffuse.cwiseMin(1.0).cast<float>());
        }
    }
    return cloud;
}

void note_violations(const Description& description, Scene& scene) {
    if (description.moved)
        scene.notes.push_back(fmt::format("'{}' is moved in one of every {} training views, as the scene describes",
                                          description.moved->shape, description.moved->every));
    if (description.exposure)
        scene.notes.push_back(
            fmt::format("views differ from the mean exposure by up to {} stops, and in white balance by up to {}, as "
                        "the scene describes",
                        description.exposure->stops, description.exposure->white_balance));
    if (description.distractors)
        scene.notes.push_back(fmt::format("other things cover {:g} % of every training view, as the scene describes",
                                          100 * description.distractors->share));
    if (description.shadow)
        scene.notes.push_back(fmt::format("a shadow falls into one of every {} training views, as the scene describes",
                                          description.shadow->every));
}

}  // namespace

std::vector<std::string> builtin_scene_names() { return procedural::embedded_scene_names(); }

Scene load_builtin_scene(const std::string& name, const SceneOptions& options) {
    Description description = procedural::load_description(name);
    apply_resolution(description.cameras, options.resolution.value_or(1));
    Scene scene;
    scene.source = "builtin:" + name;
    scene.kind = "builtin";
    const LensCamera lens = procedural::rig_lens(description.cameras);
    const Camera camera = choose_camera(lens, options.lens, scene.source);
    if (!is_pinhole(lens))
        scene.facts.push_back(fmt::format(
            "lens {}: {}", camera_model_info(lens.model).name,
            is_pinhole(camera) ? "its views are cast as pinhole images" : "its views are used as they are"));
    for (int i = 0; i < description.cameras.train; ++i) scene.train.push_back(make_view(description, camera, false, i));
    for (int i = 0; options.eval && i < description.cameras.test; ++i)
        scene.test.push_back(make_view(description, camera, true, i));
    scene.split_rule = options.eval ? "training and test cameras of the procedural scene"
                                    : "training cameras of the procedural scene, no test views";
    scene.points = sample_points(description, camera);
    scene.extent = camera_extent(scene.train, scene.points);
    note_violations(description, scene);
    return scene;
}

}  // namespace gs
