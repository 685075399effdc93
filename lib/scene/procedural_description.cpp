// SPDX-License-Identifier: Apache-2.0
// Strictly reads a procedural scene's description from YAML, and derives cameras and settings of single views.
#include "lib/scene/procedural_description.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>
#include <sstream>

#include "kernels/base/error.h"
#include "kernels/base/rng.h"
#include "lib/core/input_file.h"
#include "lib/core/nearest.h"
#include "lib/core/yaml_text.h"

namespace gs::procedural {
namespace {

template <class T> void check_range(T value, T low, T high, const std::string& where) {
    if (!(value >= low && value <= high))
        throw UsageError(fmt::format("{}: {} is outside [{}, {}]", where, value, low, high));
}

using Eigen::Vector3d;

constexpr double kDegree = M_PI / 180;
/// The limit of coordinates: far larger than needed, while arithmetic is still accurate.
constexpr double kFar = 1e6;
constexpr double kGoldenTurn = 0.6180339887498949;  ///< golden ratio - 1: spreads directions evenly for any count
/// The limit of colours: it allows lights brighter than white but catches a mistyped digit.
constexpr double kMaxColor = 10;

/// A YAML mapping that is read strictly: values are checked as they are read, and unknown keys are errors.
class YamlSection {
  public:
    /// `where` is the section's place in messages, e.g. "builtin:glossy: shapes[2]". Throws UsageError if `node` is not
    /// a mapping or holds a key that is not in `known`.
    YamlSection(const YAML::Node& node, std::string where, const std::vector<std::string>& known);

    bool has(const std::string& key) const { return node_[key].IsDefined(); }
    std::string where(const std::string& key) const { return where_ + "." + key; }
    YAML::Node node(const std::string& key) const { return node_[key]; }
    /// Returns the elements of a list, none if the key is absent. Throws UsageError if the value is not a list.
    std::vector<YAML::Node> items(const std::string& key) const;

    // Each `read` leaves `out` unchanged if the key is absent. It throws UsageError for a wrong type or a value outside
    // [low, high].
    void read(const std::string& key, std::string& out) const;
    void read(const std::string& key, double& out, double low, double high) const;
    void read(const std::string& key, int& out, int low, int high) const;
    void read(const std::string& key, Eigen::Vector3d& out, double low, double high) const;

  private:
    template <class T> T convert(const YAML::Node& node, const std::string& key, const char* expected) const;

    YAML::Node node_;
    std::string where_;
};

YamlSection::YamlSection(const YAML::Node& node, std::string where, const std::vector<std::string>& known)
    : node_(node), where_(std::move(where)) {
    if (!node.IsMap()) throw UsageError(fmt::format("{}: expected a mapping (key: value)", where_));
    std::set<std::string> keys;
    for (const auto& entry : node) {
        const std::string key = entry.first.Scalar();
        if (!keys.insert(key).second) throw UsageError(fmt::format("{}: key '{}' stands twice", where_, key));
        if (std::find(known.begin(), known.end(), key) == known.end())
            throw UsageError(fmt::format("{}: unknown key '{}'{}", where_, key, did_you_mean(key, known)));
    }
}

template <class T> T YamlSection::convert(const YAML::Node& node, const std::string& key, const char* expected) const {
    try {
        return node.as<T>();
    } catch (const YAML::Exception&) {
        throw UsageError(fmt::format("{}: expected {}, found '{}'", where(key), expected, YAML::Dump(node)));
    }
}

std::vector<YAML::Node> YamlSection::items(const std::string& key) const {
    if (!has(key)) return {};
    if (!node_[key].IsSequence()) throw UsageError(fmt::format("{}: expected a list", where(key)));
    return {node_[key].begin(), node_[key].end()};
}

void YamlSection::read(const std::string& key, std::string& out) const {
    if (has(key)) out = convert<std::string>(node_[key], key, "text");
}

void YamlSection::read(const std::string& key, double& out, double low, double high) const {
    if (!has(key)) return;
    out = convert<double>(node_[key], key, "a number");
    check_range(out, low, high, where(key));
}

void YamlSection::read(const std::string& key, int& out, int low, int high) const {
    if (!has(key)) return;
    out = convert<int>(node_[key], key, "an integer");
    check_range(out, low, high, where(key));
}

void YamlSection::read(const std::string& key, Eigen::Vector3d& out, double low, double high) const {
    if (!has(key)) return;
    const auto values = convert<std::vector<double>>(node_[key], key, "a list of three numbers");
    if (values.size() != 3)
        throw UsageError(fmt::format("{}: expected three numbers, found {}", where(key), values.size()));
    for (int k = 0; k < 3; ++k) {
        check_range(values[k], low, high, where(key));
        out[k] = values[k];
    }
}

const std::vector<std::string> kTopKeys = {"base",    "shapes", "lights",     "sky",    "ambient",   "background",
                                           "cameras", "lens",   "pixel_grid", "points", "violations"};

Vector3d unit(const YamlSection& section, const std::string& key, Vector3d v) {
    if (v.norm() < 1e-12) throw UsageError(fmt::format("{}: the zero vector has no direction", section.where(key)));
    return v.normalized();
}

Material read_material(const YAML::Node& node, const std::string& where) {
    const YamlSection section(node, where, {"albedo", "albedo2", "checker", "specular", "sharpness"});
    Material m;
    section.read("albedo", m.albedo, 0, 1);
    m.albedo2 = m.albedo;
    section.read("albedo2", m.albedo2, 0, 1);
    section.read("checker", m.checker, 0, kFar);
    section.read("specular", m.specular, 0, kMaxColor);
    section.read("sharpness", m.sharpness, 1, 1e5);
    return m;
}

Shape read_shape(const YAML::Node& node, const std::string& where) {
    const YamlSection section(node, where, {"name", "kind", "center", "radius", "half_size", "rotation", "material"});
    Shape shape;
    std::string kind = "sphere";
    section.read("name", shape.name);
    section.read("kind", kind);
    if (kind == "sphere")
        shape.kind = ShapeKind::kSphere;
    else if (kind == "box")
        shape.kind = ShapeKind::kBox;
    else if (kind == "plane")
        shape.kind = ShapeKind::kPlane;
    else
        throw UsageError(fmt::format("{}: '{}' is not one of sphere, box, plane", section.where("kind"), kind));
    section.read("center", shape.center, -kFar, kFar);
    section.read("radius", shape.radius, 1e-6, kFar);
    section.read("half_size", shape.half_size, 1e-6, kFar);
    Vector3d degrees = Vector3d::Zero();
    section.read("rotation", degrees, -360, 360);
    shape.rotation = (Eigen::AngleAxisd(degrees.z() * kDegree, Vector3d::UnitZ()) *
                      Eigen::AngleAxisd(degrees.y() * kDegree, Vector3d::UnitY()) *
                      Eigen::AngleAxisd(degrees.x() * kDegree, Vector3d::UnitX()))
                         .toRotationMatrix();
    if (section.has("material")) shape.material = read_material(section.node("material"), section.where("material"));
    return shape;
}

Light read_light(const YAML::Node& node, const std::string& where) {
    const YamlSection section(node, where, {"kind", "direction", "center", "edge_u", "edge_v", "samples", "color"});
    Light light;
    std::string kind = "directional";
    section.read("kind", kind);
    if (kind != "directional" && kind != "area")
        throw UsageError(fmt::format("{}: '{}' is not one of directional, area", section.where("kind"), kind));
    light.directional = kind == "directional";
    section.read("direction", light.direction, -kFar, kFar);
    light.direction = unit(section, "direction", light.direction);
    section.read("center", light.center, -kFar, kFar);
    section.read("edge_u", light.edge_u, -kFar, kFar);
    section.read("edge_v", light.edge_v, -kFar, kFar);
    section.read("samples", light.samples, 1, 64);
    section.read("color", light.color, 0, kMaxColor);
    return light;
}

World read_world(const YamlSection& top) {
    World world;
    for (const YAML::Node& node : top.items("shapes"))
        world.shapes.push_back(read_shape(node, top.where(fmt::format("shapes[{}]", world.shapes.size()))));
    for (const YAML::Node& node : top.items("lights"))
        world.lights.push_back(read_light(node, top.where(fmt::format("lights[{}]", world.lights.size()))));
    if (world.shapes.empty()) throw UsageError(fmt::format("{}: at least one shape is needed", top.where("shapes")));
    if (top.has("sky")) {
        const YamlSection sky(top.node("sky"), top.where("sky"), {"zenith", "horizon", "ground"});
        sky.read("zenith", world.sky.zenith, 0, kMaxColor);
        sky.read("horizon", world.sky.horizon, 0, kMaxColor);
        sky.read("ground", world.sky.ground, 0, kMaxColor);
    }
    top.read("ambient", world.ambient, 0, kMaxColor);
    const bool sky_seen =
        !top.has("background") || (top.node("background").IsScalar() && top.node("background").Scalar() == "sky");
    if (!sky_seen) {
        world.background = Vector3d::Zero();
        top.read("background", *world.background, 0, 1);
    }
    return world;
}

CameraRig read_cameras(const YAML::Node& node, const std::string& where) {
    const YamlSection section(
        node, where,
        {"width", "height", "fov", "radius", "elevation_min", "elevation_max", "look_at", "turn", "train", "test"});
    CameraRig rig;
    section.read("width", rig.width, 8, 16384);
    section.read("height", rig.height, 8, 16384);
    constexpr int kMaxPixels = 1 << 24;  // a few bytes of YAML must not request all memory
    if (rig.width * rig.height > kMaxPixels)
        throw UsageError(fmt::format("{}: {}x{} pixels are too many; at most {} are drawn", where, rig.width,
                                     rig.height, kMaxPixels));
    section.read("fov", rig.fov, 1, 170);
    section.read("radius", rig.radius, 1e-3, kFar);
    // Straight up and down are excluded, because the image's up direction is undefined there.
    section.read("elevation_min", rig.elevation_min, -89, 89);
    section.read("elevation_max", rig.elevation_max, rig.elevation_min, 89);
    section.read("look_at", rig.look_at, -kFar, kFar);
    section.read("turn", rig.turn, 0, 180);
    section.read("train", rig.train, 1, 10000);
    section.read("test", rig.test, 0, 10000);
    return rig;
}

/// Reads the lens of the cameras, which replaces their pinhole.
void read_lens(const YAML::Node& node, const std::string& where, CameraRig& rig) {
    const YamlSection section(node, where, {"model", "distortion", "fov"});
    std::string name;
    section.read("model", name);
    const auto models = camera_models();
    const auto found = std::find_if(models.begin(), models.end(), [&](const auto& m) { return m.name == name; });
    if (found == models.end())
        throw UsageError(fmt::format("{}: '{}' is no camera model of COLMAP", section.where("model"), name));
    rig.model = found->id;
    const std::vector<YAML::Node> values = section.items("distortion");
    if (int(values.size()) != found->num_distortion)
        throw UsageError(fmt::format("{}: {} has {} numbers, found {}", section.where("distortion"), name,
                                     found->num_distortion, values.size()));
    for (std::size_t k = 0; k < values.size(); ++k) {
        try {
            rig.distortion[k] = values[k].as<double>();
        } catch (const YAML::Exception&) {
            throw UsageError(fmt::format("{}: expected numbers", section.where("distortion")));
        }
        check_range(rig.distortion[k], -100.0, 100.0, section.where("distortion"));
    }
    section.read("fov", rig.fov, 1, 359);
    if (!(rig_lens(rig).fx > 0))
        throw UsageError(fmt::format("{}: {} does not reach {} degrees", section.where("fov"), name, rig.fov));
}

void read_violations(const YAML::Node& node, const std::string& where, Description& out) {
    const YamlSection section(node, where, {"moved", "exposure", "shadow", "distractors"});
    if (section.has("moved")) {
        const YamlSection moved(section.node("moved"), section.where("moved"), {"shape", "offset", "every"});
        out.moved.emplace();
        moved.read("shape", out.moved->shape);
        moved.read("offset", out.moved->offset, -kFar, kFar);
        moved.read("every", out.moved->every, 1, 10000);
        const auto& shapes = out.world.shapes;
        if (std::none_of(shapes.begin(), shapes.end(), [&](const Shape& s) { return s.name == out.moved->shape; }))
            throw UsageError(fmt::format("{}: no shape is named '{}'", moved.where("shape"), out.moved->shape));
    }
    if (section.has("exposure")) {
        const YamlSection exposure(section.node("exposure"), section.where("exposure"),
                                   {"stops", "white_balance", "vignetting", "seed"});
        out.exposure.emplace();
        int seed = 0;
        exposure.read("stops", out.exposure->stops, 0, 10);
        exposure.read("white_balance", out.exposure->white_balance, 0, 10);
        exposure.read("vignetting", out.exposure->vignetting, 0, 1);
        exposure.read("seed", seed, 0, 1 << 30);
        out.exposure->seed = std::uint64_t(seed);
    }
    if (section.has("shadow")) {
        const YamlSection shadow(section.node("shadow"), section.where("shadow"), {"from", "to", "radius", "every"});
        out.shadow.emplace();
        shadow.read("from", out.shadow->from, -kFar, kFar);
        shadow.read("to", out.shadow->to, -kFar, kFar);
        shadow.read("radius", out.shadow->radius, 1e-6, kFar);
        shadow.read("every", out.shadow->every, 1, 10000);
    }
    if (section.has("distractors")) {
        const YamlSection distractors(section.node("distractors"), section.where("distractors"), {"share", "seed"});
        out.distractors.emplace();
        int seed = 0;
        distractors.read("share", out.distractors->share, 0, 0.9);
        distractors.read("seed", seed, 0, 1 << 30);
        out.distractors->seed = std::uint64_t(seed);
    }
}

YAML::Node description_yaml(const std::string& text, const std::string& origin) {
    try {
        return parse_yaml(text);
    } catch (const YAML::Exception& e) {
        throw UsageError(fmt::format("{}: not valid YAML, line {}: {}", origin, e.mark.line + 1, e.msg));
    }
}

const char* known_scene(const std::string& name, const std::string& where) {
    if (const char* text = embedded_scene(name)) return text;
    throw UsageError(fmt::format("{}builtin:{}: no such scene; known are {} (or the path of a .yaml file)", where, name,
                                 fmt::join(embedded_scene_names(), ", ")));
}

/// Merges `base: NAME`: keys of the file replace the same keys of the base scene.
YAML::Node with_base(const YAML::Node& node, const std::string& where) {
    if (!node.IsMap() || !node["base"]) return node;
    YAML::Node merged = with_base(parse_yaml(known_scene(node["base"].as<std::string>(), where)), where);
    for (const auto& entry : node) merged[entry.first.Scalar()] = entry.second;
    return merged;
}

}  // namespace

Description parse_description(const std::string& text, const std::string& origin) {
    const YAML::Node own = description_yaml(text, origin);
    const YamlSection checked(own, origin, kTopKeys);  // before merging, so that messages refer to this file
    std::string base;
    checked.read("base", base);
    const YamlSection top(with_base(own, origin + ": base: "), origin, kTopKeys);
    Description description;
    description.world = read_world(top);
    if (top.has("cameras")) description.cameras = read_cameras(top.node("cameras"), top.where("cameras"));
    if (top.has("lens")) read_lens(top.node("lens"), top.where("lens"), description.cameras);
    top.read("pixel_grid", description.pixel_grid, 1, 16);
    top.read("points", description.points, 0, 10000000);
    if (top.has("violations")) read_violations(top.node("violations"), top.where("violations"), description);
    return description;
}

Description load_description(const std::string& name) {
    const bool is_file = name.size() > 5 && (name.ends_with(".yaml") || name.ends_with(".yml"));
    if (!is_file) return parse_description(known_scene(name, ""), "builtin:" + name);
    return parse_description(read_input(name), name);
}

LensCamera rig_lens(const CameraRig& rig) {
    LensCamera lens{.model = rig.model, .width = rig.width, .height = rig.height};
    if (rig.model == CameraModel::kEquirectangular) {
        lens.fx = rig.width, lens.fy = rig.height;
        return lens;
    }
    const double half = 0.5 * rig.fov * kDegree;
    double edge = std::tan(half);  // normalised image coordinate of the left and right border
    lens.distortion = rig.distortion;
    if (!is_pinhole(lens)) {
        lens.fx = lens.fy = 1;
        const auto at = project(lens, {std::sin(half), 0, std::cos(half)});
        edge = at ? at->x() : 0;
    }
    lens.fx = lens.fy = edge > 0 ? 0.5 * rig.width / edge : 0;
    lens.cx = 0.5 * rig.width, lens.cy = 0.5 * rig.height;
    return lens;
}

/// Returns a direction at most `angle` radians from another.
Vector3d turned(double angle, const Vector3d& forward, bool test, int index) {
    // Streams 0 to 2 are those of the points and of photography().
    const Philox4 bits = philox(0, RngStream::kScene, test ? 4 : 3, std::uint32_t(index));
    const double cosine = 1 - uniform_from_bits<double>(bits.v[0]) * (1 - std::cos(angle)),
                 azimuth = 2 * M_PI * uniform_from_bits<double>(bits.v[1]), sine = std::sqrt(1 - cosine * cosine);
    const Vector3d side = forward.unitOrthogonal(), other = forward.cross(side);
    return cosine * forward + sine * (std::cos(azimuth) * side + std::sin(azimuth) * other);
}

Camera rig_camera(const CameraRig& rig, bool test, int index) {
    // Training azimuths advance by the golden angle while the heights increase steadily. Test azimuths are evenly
    // spaced and the heights are mixed, so that no test view repeats a training view.
    const double count = test ? rig.test : rig.train;
    const double even = (index + 0.5) / count, spread = std::fmod(index * kGoldenTurn, 1.0);
    const double azimuth = 2 * M_PI * (test ? even : spread);
    const double elevation =
        kDegree * (rig.elevation_min + (rig.elevation_max - rig.elevation_min) * (test ? spread : even));
    const Vector3d outward(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                           std::sin(elevation));
    const Vector3d forward = rig.turn > 0 ? turned(rig.turn * kDegree, -outward, test, index) : Vector3d(-outward);
    const Vector3d right = forward.cross(Vector3d::UnitZ()).normalized(), down = forward.cross(right);
    Camera camera;
    static_cast<LensCamera&>(camera) = rig_lens(rig);
    camera.rotation.row(0) = right;
    camera.rotation.row(1) = down;
    camera.rotation.row(2) = forward;
    camera.translation = -camera.rotation * (rig.look_at + rig.radius * outward);
    return camera;
}

namespace {

/// The largest number of distractors in a view.
constexpr int kMostDistractors = 64;

/// Returns the shape that training view `index` sees at a random pixel as number `k` of its distractors.
Shape distractor(const Description& description, const Camera& camera, int index, int k) {
    const Distractors& distractors = *description.distractors;
    const auto number = std::uint32_t(index * kMostDistractors + k);
    // Streams 0 to 4 are those of the points, of photography() and of turned().
    const Philox4 place = philox(distractors.seed, RngStream::kScene, 5, number),
                  look = philox(distractors.seed, RngStream::kScene, 6, number);
    const auto in = [](std::uint32_t bits, double from, double to) {
        return from + (to - from) * uniform_from_bits<double>(bits);
    };
    Shape shape;
    shape.name = "distractor";
    shape.blocks_light = false;  // its shadow would darken far more of the picture than it covers
    const auto ray = camera_ray(camera, in(place.v[0], 0, camera.width), in(place.v[1], 0, camera.height));
    if (!ray) return shape.radius = 0, shape;
    const auto hit = intersect(description.world, *ray);
    const double depth = in(place.v[2], 0.4, 0.9) * (hit ? hit->t : description.cameras.radius);
    // A third of the share in the mean, so that a few are needed.
    const double pixels = std::sqrt(distractors.share * camera.width * camera.height / (3 * M_PI));
    shape.center = ray->origin + depth * ray->direction;
    shape.radius = in(place.v[3], 0.6, 1.3) * pixels / camera.fx * depth;
    for (int c = 0; c < 3; ++c) shape.material.albedo[c] = in(look.v[c], 0.05, 0.95);
    shape.material.albedo2 = 0.5 * shape.material.albedo;
    if (look.v[3] & 1) shape.material.checker = 0.5 * shape.radius;
    if (look.v[3] & 2) {
        shape.kind = ShapeKind::kBox;
        shape.half_size = Vector3d(0.6, 0.6, 1) * shape.radius;
    }
    return shape;
}

/// Adds distractors to the world of a training view.
void add_distractors(const Description& description, int index, World& world) {
    constexpr int kRays = 48;  // per side of the picture, to measure what is covered
    const Camera camera = rig_camera(description.cameras, false, index);
    std::vector<std::pair<Ray, double>> open;  // rays that reach the scene, and how far they go
    for (int i = 0; i < kRays * kRays; ++i) {
        const auto ray =
            camera_ray(camera, (i % kRays + 0.5) / kRays * camera.width, (i / kRays + 0.5) / kRays * camera.height);
        if (!ray) continue;
        const auto hit = intersect(description.world, *ray);
        open.emplace_back(*ray, hit ? hit->t : kFar);
    }
    const double most_open = (1 - description.distractors->share) * double(open.size());
    for (int k = 0; k<kMostDistractors&& double(open.size())> most_open; ++k) {
        const Shape shape = distractor(description, camera, index, k);
        World alone;
        alone.shapes = {shape};
        std::erase_if(open, [&](const auto& ray) {
            const auto hit = intersect(alone, ray.first);
            return hit && hit->t < ray.second;
        });
        world.shapes.push_back(shape);
    }
}

}  // namespace

World train_world(const Description& description, int index) {
    World world = description.world;
    const auto chosen = [&](int every) { return index % every == every - 1; };
    if (description.moved && chosen(description.moved->every)) {
        for (Shape& shape : world.shapes) {
            if (shape.name == description.moved->shape) shape.center += description.moved->offset;
        }
    }
    if (description.shadow && chosen(description.shadow->every)) {
        Shape blocker;
        blocker.name = "passing shadow";
        blocker.radius = description.shadow->radius;
        blocker.visible = false;
        const double along = (index + 0.5) / description.cameras.train;
        blocker.center = description.shadow->from + along * (description.shadow->to - description.shadow->from);
        world.shapes.push_back(blocker);
    }
    if (description.distractors) add_distractors(description, index, world);
    return world;
}

Photography photography(const Description& description, bool test, int index) {
    if (!description.exposure) return {};
    const ExposureJitter& jitter = *description.exposure;
    // Stream 1 is used for the initial points.
    const Philox4 bits = philox(jitter.seed, RngStream::kScene, test ? 2 : 0, std::uint32_t(index));
    const auto drawn = [&](int k, double range) { return range * (2 * uniform_from_bits<double>(bits.v[k]) - 1); };
    const Vector3d gain(drawn(1, jitter.white_balance), drawn(2, jitter.white_balance), drawn(3, jitter.white_balance));
    Photography out;
    out.stops = drawn(0, jitter.stops);
    for (int c = 0; c < 3; ++c) out.gain[c] = std::exp2(gain[c] - gain.mean());
    return out;
}

Vector3d exposure_factor(const Description& description, const Photography& photography, int x, int y) {
    const double width = description.cameras.width, height = description.cameras.height;
    const double dx = x + 0.5 - 0.5 * width, dy = y + 0.5 - 0.5 * height;
    const double lost = description.exposure ? description.exposure->vignetting : 0;
    return std::exp2(photography.stops) * (1 - lost * 4 * (dx * dx + dy * dy) / (width * width + height * height)) *
           photography.gain;
}

}  // namespace gs::procedural
