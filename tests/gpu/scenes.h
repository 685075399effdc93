// SPDX-License-Identifier: Apache-2.0
// The scenes on which backends are compared with the reference in double.
#pragma once

#include <functional>
#include <numbers>
#include <numeric>
#include <optional>

#include "tests/gpu/gpu_test.h"
#include "tests/kernels/lenses.h"

namespace gs::test {

struct TestScene {
    Gaussians model;
    CameraParams<float> camera;
    Vec3<float> background{0.3f, 0.6f, 0.1f};
    int channels = 3;
    bool masked = false, floats = false;
    std::optional<int> clear_from;  ///< the first column of the target that is transparent, as are all right of it
    /// Half of the error bounds must lie below this share of the largest value, or they would not say anything.
    double rounding_share = 2e-3;
    bool round = false;  ///< Gaussians are spheres: gradients of rotations are nothing but rounding
};

struct NamedScene {
    const char* name;
    std::function<TestScene()> make;
    bool is_large = false;  ///< the reference takes the CPU half a minute or more
    friend std::ostream& operator<<(std::ostream& out, const NamedScene& s) { return out << s.name; }
};

/// Returns the point in the world that a pixel shows at this depth.
inline Vec3<double> unproject(const CameraParams<double>& c, double x, double y, double depth) {
    return c.rotation.transposed_times(Vec3<double>{(x - c.cx) / c.fx * depth, (y - c.cy) / c.fy * depth, depth} -
                                       c.translation);
}
inline void place(GaussianState<double>& s, std::int64_t i, const Vec3<double>& p) {
    double* m = &s[Group::kMean].param[3 * i];
    m[0] = p.x, m[1] = p.y, m[2] = p.z;
}

/// Moves Gaussians in front of the camera along its axis until their depths differ by 1e-5: ten times what the sort
/// resolves and far above rounding, so that there is one order of blending.
inline void separate_depths(GaussianState<double>& s, const CameraParams<double>& c) {
    const auto mean = [&](std::int64_t i) {
        return Vec3<double>{s[Group::kMean].param[3 * i], s[Group::kMean].param[3 * i + 1],
                            s[Group::kMean].param[3 * i + 2]};
    };
    std::vector<std::pair<double, std::int64_t>> order;
    for (std::int64_t i = 0; i < s.count; ++i)
        if (const double z = dot(c.rotation.r2, mean(i)) + c.translation.z; z > 0) order.push_back({z, i});
    std::sort(order.begin(), order.end());
    double last = 0;
    for (const auto& [z, i] : order) {
        const double wanted = std::max(z, last * (1 + 1e-5));
        place(s, i, mean(i) + c.rotation.r2 * (wanted - z));
        last = wanted;
    }
}

inline TestScene finished(GaussianState<double> s, const CameraParams<double>& camera) {
    separate_depths(s, camera);
    TestScene t;
    t.model = float_model(s), t.camera = cast<float>(camera);
    return t;
}

/// Returns random Gaussians whose log scales are moved by `size`.
inline TestScene random_scene(std::int64_t n, int degree, int width, int height, double size, std::uint32_t seed) {
    auto s = random_gaussians(n, degree, seed);
    for (double& x : s[Group::kScale].param) x += size;
    return finished(std::move(s), test_camera(width, height));
}

/// Returns faint Gaussians around one pixel (spread 0: exactly there): one tile with a list of many chunks and saved
/// states.
inline TestScene one_tile_scene(double spread, double raw_opacity) {
    const auto camera = test_camera(30, 22);
    auto s = random_gaussians(5000, 1, 31);
    std::mt19937 rng(32);
    std::normal_distribution<double> normal;
    for (std::int64_t i = 0; i < s.count; ++i) {
        place(s, i, unproject(camera, 8.4 + spread * normal(rng), 5.7 + spread * normal(rng), 3 + 0.0004 * double(i)));
        for (int k = 0; k < 3; ++k) s[Group::kScale].param[3 * i + k] = -3 - 0.5 * k;  // less than a pixel
        s[Group::kOpacity].param[i] = raw_opacity;
    }
    return finished(std::move(s), camera);
}

/// Returns one tile with a long list that opaque Gaussians begin: four of its columns are finished long before the
/// others of their sub-tiles.
inline TestScene half_finished_tile_scene() {
    constexpr int kColumns = 4, kTileRows = 12, kLayers = 5, kOpaque = kColumns * kTileRows * kLayers;
    const auto camera = test_camera(30, 22);
    auto s = random_gaussians(kOpaque + 1500, 1, 33);
    std::mt19937 rng(34);
    std::normal_distribution<double> normal;
    for (std::int64_t i = 0; i < s.count; ++i) {
        const bool opaque = i < kOpaque;
        const double x = opaque ? 0.5 + double(i % kColumns) : 8.4 + 1.5 * normal(rng),
                     y = opaque ? 0.5 + double(i / kColumns % kTileRows) : 5.7 + 1.5 * normal(rng);
        place(s, i, unproject(camera, x, y, (opaque ? 2 : 3) + 0.0004 * double(i)));
        for (int k = 0; k < 3; ++k) s[Group::kScale].param[3 * i + k] = -3 - 0.5 * k;  // less than a pixel
        s[Group::kOpacity].param[i] = opaque ? 4 : -4;
    }
    return finished(std::move(s), camera);
}

/// Returns Gaussians in all directions that a lens shows: in the middle of the image, at its rim, beside it, and across
/// the seam of a 360-degree image, whose poles stay free.
inline TestScene scene_around(const TestLens& lens, int width, int height) {
    const CameraParams<double> camera = lens_camera(lens, width, height);
    auto s = random_gaussians(400, 2, 95);
    std::mt19937 rng(96);
    const auto random = [&] { return double(rng() % 100000) / 99999; };
    for (std::int64_t i = 0; i < s.count; ++i) {
        const double azimuth = 2 * std::numbers::pi * random();
        Vec3<double> d;
        if (lens.lens.wraps()) {
            const double latitude = 1.6 * (random() - 0.5);
            d = {std::cos(latitude) * std::sin(azimuth), std::sin(latitude), std::cos(latitude) * std::cos(azimuth)};
        } else {
            const double angle = 1.1 * lens.lens.max_angle * std::sqrt(random());
            d = {std::sin(angle) * std::cos(azimuth), std::sin(angle) * std::sin(azimuth), std::cos(angle)};
        }
        // In steps of depth that no rounding closes, so that there is one order of blending.
        const double distance = 2 * std::exp(0.004 * double(i)) / depth_of(d, camera);
        place(s, i, camera.rotation.transposed_times(d * distance - camera.translation));
        for (int k = 0; k < 3; ++k)
            s[Group::kScale].param[3 * i + k] =
                std::log(distance) - 3.2 + 0.5 * std::tanh(s[Group::kScale].param[3 * i + k]);
    }
    TestScene t;
    t.model = float_model(s), t.camera = cast<float>(camera);
    return t;
}

/// Returns Gaussians behind the camera.
inline TestScene behind_scene() {
    const auto camera = test_camera(50, 40);
    auto s = random_gaussians(300, 3, 41);
    for (std::int64_t i = 0; i < s.count; ++i)
        place(s, i, unproject(camera, double(i % 50), double(i % 40), -0.5 - 0.01 * double(i)));
    return finished(std::move(s), camera);
}

/// Returns Gaussians that each cover the whole image.
inline TestScene huge_scene() {
    const auto camera = test_camera(200, 150);
    auto s = random_gaussians(40, 3, 51);
    for (double& x : s[Group::kScale].param) x = 1.5 + 0.5 * std::tanh(x);
    for (double& x : s[Group::kOpacity].param) x = -3 + x;
    return finished(std::move(s), camera);
}

/// Returns Gaussians of scale ratio 1e4 at all angles. The longer they are, the more of the determinant cancels, and
/// the bounds say so.
inline TestScene needle_scene(std::int64_t n, double log_length) {
    auto s = random_gaussians(n, 2, 61);
    for (std::int64_t i = 0; i < s.count; ++i)
        for (int k = 0; k < 3; ++k) s[Group::kScale].param[3 * i + k] = log_length - (k == i % 3 ? 0 : std::log(1e4));
    return finished(std::move(s), test_camera(320, 240));
}

/// Returns Gaussians with means on corners and edges of tiles and sub-tiles, and with outlines that end there, too.
inline TestScene border_scene() {
    CameraParams<double> camera = test_camera(100, 74);
    camera.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    camera.translation = {0, 0, 4}, camera.position = {0, 0, -4};
    camera.fx = camera.fy = 64, camera.cx = 48, camera.cy = 36;
    auto s = random_gaussians(13 * 19, 1, 71);
    for (std::int64_t i = 0; i < s.count; ++i) {
        place(s, i, unproject(camera, 8.0 * double(i % 13), 4.0 * double(i / 13), 4 + 0.01 * double(i)));
        s[Group::kOpacity].param[i] = i % 3 - 1.0;
        // The outline is reach sigma from the mean: 4, 8, 12 or 16 pixels.
        const double reach = std::sqrt(2 * std::log(255 / (1 + std::exp(-s[Group::kOpacity].param[i])))),
                     sigma = (4 + 4.0 * double(i % 4)) / reach;
        for (int k = 0; k < 3; ++k)
            s[Group::kScale].param[3 * i + k] =
                0.5 * std::log(sigma * sigma - 0.3) - std::log(64 / (4 + 0.01 * double(i)));
    }
    TestScene t = finished(std::move(s), camera);
    t.round = true;
    return t;
}

/// Returns Gaussians in the left third of the picture. Right of the middle the target is transparent, so that both
/// pictures show nothing but the background in whole tiles of the loss: in the first of them without its border, in the
/// others with it.
inline TestScene beside_plain_background_scene() {
    const auto camera = test_camera(240, 140);
    auto s = random_gaussians(300, 3, 91);
    std::mt19937 rng(92);
    for (std::int64_t i = 0; i < s.count; ++i) {
        place(s, i, unproject(camera, double(rng() % 80), double(rng() % 140), 3 + 0.01 * double(i)));
        for (int k = 0; k < 3; ++k) s[Group::kScale].param[3 * i + k] = -3 - 0.3 * k;
    }
    TestScene t = finished(std::move(s), camera);
    t.channels = 4, t.clear_from = 128;
    return t;
}

inline TestScene with(TestScene s, std::function<void(TestScene&)> change) {
    change(s);
    return s;
}

inline std::vector<NamedScene> test_scenes() {
    const auto target = [](int degree, int channels, bool masked, bool floats) {
        return with(random_scene(120, degree, 110, 80, -0.5, 80 + degree), [=](TestScene& s) {
            std::mt19937 rng(90 + degree);
            const auto random = [&] { return float(rng() % 1000) / 999.0f; };
            s.background = {random(), random(), random()};
            s.channels = channels, s.masked = masked, s.floats = floats;
        });
    };
    return {
        {"Empty", [] { return random_scene(0, 3, 33, 25, 0, 1); }},
        {"OnePixelOneGaussian",
         [] { return with(random_scene(1, 3, 1, 1, 0, 1), [](TestScene& s) { s.rounding_share = 0.1; }); }},
        {"OnePixelFortyGaussians", [] { return random_scene(40, 3, 1, 1, 0.5, 6); }},
        {"OneGaussian",
         [] { return with(random_scene(1, 3, 33, 25, 0, 3), [](TestScene& s) { s.rounding_share = 0.1; }); }},
        {"SmallerThanTheWindow", [] { return random_scene(60, 3, 17, 13, 0, 2); }},
        {"Lego", [] { return random_scene(10000, 3, 800, 800, -2.5, 3); }, true},
        {"Large", [] { return random_scene(60, 3, 3840, 2160, -1, 4); }, true},
        {"None", [] { return random_scene(500, 0, 130, 70, -1, 5); }},
        {"OneTile", [] { return one_tile_scene(1.5, -4); }},
        {"OnePixelOfMany", [] { return one_tile_scene(0, -4.8); }},
        {"HalfFinishedTile", half_finished_tile_scene},
        {"Behind", [] { return behind_scene(); }},
        {"Huge", [] { return huge_scene(); }},
        {"ShortNeedles", [] { return with(needle_scene(240, -2), [](TestScene& s) { s.rounding_share = 0.02; }); }},
        {"LongNeedles", [] { return with(needle_scene(60, -0.8), [](TestScene& s) { s.rounding_share = 0.3; }); }},
        {"BesidePlainBackground", beside_plain_background_scene},
        {"Borders", [] { return border_scene(); }},
        {"Fisheye200", [] { return scene_around(test_lenses()[0], 150, 110); }},
        {"ThinPrism", [] { return scene_around(drawn_as_pinholes(test_lenses()[2]), 120, 90); }},
        {"Opencv", [] { return scene_around(test_lenses()[5], 130, 90); }},
        {"Equirectangular", [] { return scene_around(drawn_as_pinholes(equirectangular_lens()), 200, 100); }},
        {"Antialiased",
         [=] { return with(target(2, 3, false, false), [](TestScene& s) { s.model = antialiased(s.model); }); }},
        {"AntialiasedFisheye",
         [] {
             return with(scene_around(test_lenses()[0], 150, 110),
                         [](TestScene& s) { s.model = antialiased(s.model); });
         }},
        {"DegreeZero",
         [=] { return with(target(0, 3, false, false), [](TestScene& s) { s.model.appearance.model = "sh"; }); }},
        {"DegreeOneAlpha", [=] { return target(1, 4, false, false); }},
        {"DegreeTwoMask", [=] { return target(2, 3, true, false); }},
        {"DegreeThreeFloatAlpha", [=] { return target(3, 4, false, true); }},
        {"FloatMask", [=] { return target(3, 3, true, true); }},
        {"InactiveBands",
         [=] { return with(target(3, 4, true, false), [](TestScene& s) { s.model.active_degree = 1; }); }},
        {"NoBandActive",
         [=] { return with(target(3, 3, false, true), [](TestScene& s) { s.model.active_degree = 0; }); }},
    };
}

/// Names a parameter for INSTANTIATE_TEST_SUITE_P.
inline std::string scene_name(const ::testing::TestParamInfo<NamedScene>& info) { return info.param.name; }

}  // namespace gs::test
