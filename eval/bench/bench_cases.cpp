// SPDX-License-Identifier: Apache-2.0
// Generates Gaussians on the surfaces of spheres and cameras around them, and combines subjects and backends into
// measurements.
#include "eval/bench/bench_cases.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <memory>

#include "appearance/model_info.h"
#include "eval/metrics/quantize.h"
#include "kernels/base/parallel.h"
#include "kernels/base/rng.h"
#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/scene/camera_params.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"

namespace gs {
namespace {

using Eigen::Vector3d;

constexpr int kNumSpheres = 16;
constexpr int kNumCameras = 8;
/// Camera distance (world units) and focal length (px) at which the ball fills the image's height and most of its
/// width.
constexpr double kDistance = 1.9, kFocal = 800;

/// Draws the random numbers of one Gaussian, four at a time.
class Draw {
  public:
    Draw(std::uint64_t seed, std::uint64_t index) : seed_(seed), index_(index) {}
    std::array<double, 4> uniforms() {
        const Philox4 r = next();
        return {uniform_from_bits<double>(r.v[0]), uniform_from_bits<double>(r.v[1]), uniform_from_bits<double>(r.v[2]),
                uniform_from_bits<double>(r.v[3])};
    }
    std::array<float, 4> normals() {
        std::array<float, 4> n;
        normals_from(next(), n.data());
        return n;
    }

  private:
    Philox4 next() { return philox(seed_, RngStream::kScene, index_, block_++); }
    std::uint64_t seed_, index_;
    std::uint32_t block_ = 0;
};

Vector3d direction(double u, double v) {
    const double z = 2 * u - 1, r = std::sqrt(1 - z * z), angle = 2 * M_PI * v;
    return {r * std::cos(angle), r * std::sin(angle), z};
}

struct Sphere {
    Vector3d center;
    double radius;
};

std::array<Sphere, kNumSpheres> spheres(std::uint64_t seed) {
    std::array<Sphere, kNumSpheres> out;
    for (int k = 0; k < kNumSpheres; ++k) {
        const auto u =
            // The indices lie beyond those of the Gaussians.
            Draw(seed, (std::uint64_t(1) << 40) + std::uint64_t(k)).uniforms();
        out[std::size_t(k)] = {0.7 * std::cbrt(u[2]) * direction(u[0], u[1]), 0.1 + 0.2 * u[3]};
    }
    return out;
}

Vector3d position(Draw& draw, const std::array<Sphere, kNumSpheres>& surfaces) {
    const auto u = draw.uniforms(), w = draw.uniforms();
    const Vector3d d = direction(u[1], u[2]);
    if (u[0] >= 0.85) return std::cbrt(u[3]) * d;
    const Sphere& s = surfaces[std::size_t(w[0] * kNumSpheres)];
    return s.center + (s.radius + 0.005 * (2 * u[3] - 1)) * d;
}

}  // namespace

Gaussians generated_gaussians(std::int64_t count, std::uint64_t seed, const AppearanceSpec& appearance) {
    const ModelInfo& model = appearance_model(appearance.model);
    const auto surfaces = spheres(seed);
    Gaussians g;
    g.count = count;
    g.appearance = appearance;
    g.active_degree = appearance.max_degree;
    for (int i = 0; i < kNumGroups; ++i) {
        g.groups[i].width = group_width(Group(i), appearance);
        g.groups[i].param.resize(std::size_t(count) * std::size_t(g.groups[i].width));
    }
    g.shared.width = model.num_shared;
    g.shared.param.resize(std::size_t(model.num_shared));
    if (model.num_shared > 0) model.init_shared(seed, g.shared.param.data());
    for (float& w : g.shared.param) w = w == 0 ? 0.1f : w;  // an output layer that starts at 0 would have no effect
    const double log_scale = std::log(0.5 / std::cbrt(double(count)));
    parallel_for_rows(count, [&](std::int64_t i) {
        Draw draw(seed, std::uint64_t(i));
        const auto row = [&](Group group) { return g[group].param.data() + i * g[group].width; };
        const Vector3d p = position(draw, surfaces);
        const auto size = draw.normals(), rotation = draw.normals(), look = draw.normals();
        for (int c = 0; c < 3; ++c) {
            row(Group::kMean)[c] = float(p[c]);
            row(Group::kScale)[c] = float(log_scale) + 0.5f * size[3] + 0.5f * size[std::size_t(c)];
            row(Group::kBase)[c] = 0.3f * look[std::size_t(c)];
        }
        for (int c = 0; c < 4; ++c) row(Group::kRotation)[c] = rotation[std::size_t(c)];
        row(Group::kOpacity)[0] = i % 2 ? -2 + look[3] : 1.5f + 2 * look[3];
        const int width = g[Group::kResidual].width;
        model.init_residual(appearance.max_degree, row(Group::kResidual));
        for (int c = 0; c < width; c += 4) {
            const auto n = draw.normals();
            for (int k = c; k < std::min(width, c + 4); ++k) row(Group::kResidual)[k] += 0.05f * n[std::size_t(k - c)];
        }
    });
    return g;
}

std::vector<Camera> generated_cameras() {
    std::vector<Camera> cameras(kNumCameras);
    for (int k = 0; k < kNumCameras; ++k) {
        Camera& camera = cameras[std::size_t(k)];
        camera.width = 1280, camera.height = 720;
        camera.fx = camera.fy = kFocal, camera.cx = 640, camera.cy = 360;
        const double angle = 2 * M_PI * k / kNumCameras, elevation = k % 2 ? 0.6 : 0.2;
        const Vector3d away(std::cos(elevation) * std::cos(angle), std::cos(elevation) * std::sin(angle),
                            std::sin(elevation));
        const Vector3d right = (-away).cross(Vector3d::UnitZ()).normalized();
        camera.rotation.row(0) = right;
        camera.rotation.row(1) = (-away).cross(right);
        camera.rotation.row(2) = -away;
        camera.translation = -camera.rotation * (kDistance * away);
    }
    return cameras;
}

Scene generated_scene(Backend& backend, const Vec3<float>& background) {
    Scene scene;
    scene.source = scene.kind = "generated";
    scene.split_rule = "no test views";
    for (const Camera& camera : generated_cameras()) {
        View view;
        view.name = "orbit_" + std::to_string(scene.train.size());
        view.camera = camera;
        RenderRequest request;
        request.camera = camera_params(camera);
        request.background = background;
        RenderedImage rendered;
        backend.render(request, rendered);
        const auto image = std::make_shared<const ViewImage>(ViewImage{quantized_render(rendered), std::nullopt});
        view.load = [image] { return *image; };
        view.image_bytes = image->color.bytes();
        scene.train.push_back(std::move(view));
    }
    scene.extent = camera_extent(scene.train, scene.points);
    return scene;
}

BenchOptions bench_options(Device device, int repeat, int frame_repeat) {
    const bool cuda = uses_cuda(device);
    return {.repeat = repeat > 0 ? repeat
                      : cuda     ? 100
                                 : 20,
            .frame_repeat = frame_repeat > 0 ? frame_repeat
                            : cuda           ? 100
                                             : 3};
}

BenchResult bench_model(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                        const BenchOptions& bench, bool compare_deterministic) {
    BenchResult result = run_bench(backend, options, scene, model, bench);
    if (!compare_deterministic) return result;
    EngineOptions other = engine_options(options);
    other.deterministic = !other.deterministic;
    const auto changed = make_backend(options.device, model.appearance, other);
    const double seconds = iteration_seconds(*changed, options, scene, model, bench);
    result.deterministic_seconds = options.deterministic ? result.iteration_seconds : seconds;
    result.default_seconds = options.deterministic ? seconds : result.iteration_seconds;
    return result;
}

BenchResult bench_generated(Backend& backend, const TrainOptions& options, std::int64_t count,
                            const BenchOptions& bench, bool compare_deterministic) {
    const Gaussians model = generated_gaussians(count, options.seed, appearance_spec(options));
    backend.upload(model);
    const Scene scene = generated_scene(backend, options.background.color);
    BenchResult result = bench_model(backend, options, scene, model, bench, compare_deterministic);
    result.subject = fmt::format("generated set of {:.3g} M Gaussians, seed {}", double(count) / 1e6, options.seed);
    return result;
}

}  // namespace gs
