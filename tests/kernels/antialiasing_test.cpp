// SPDX-License-Identifier: Apache-2.0
// Antialiased models: the 3-D filter by the training cameras and as a part of the Gaussians, and what a smaller picture
// looks like. Their gradients are with those of other models (gradient_test.cpp, lens_test.cpp).
#include <gtest/gtest.h>

#include <cmath>

#include "appearance/none/none.h"
#include "kernels/densify/densify.h"
#include "kernels/splat/smoothing.h"
#include "kernels/splat/smoothing_device.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/lenses.h"
#include "tests/kernels/random_scene.h"
#include "tests/kernels/rank_threads.h"

namespace gs::test {
namespace {

/// Returns a camera at `distance` before the origin, without rotation.
CameraParams<double> camera_before(double distance, double focal, int size) {
    CameraParams<double> c{};
    c.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    c.translation = {0, 0, distance}, c.position = {0, 0, -distance};
    c.fx = c.fy = focal, c.cx = c.cy = 0.5 * size;
    c.width = c.height = size;
    return c;
}

TEST(Smoothing, IsAFifthOfASquarePixelInTheSharpestView) {
    const Vec3<double> origin{0, 0, 0};
    const CameraParams<double> far = camera_before(8, 100, 64), near = camera_before(2, 100, 64);
    CameraParams<double> behind = camera_before(2, 1000, 64), beside = camera_before(2, 1000, 64);
    behind.translation.z = -2, beside.translation.x = 1;
    const CameraParams<double> all[] = {far, behind, near, beside};
    EXPECT_NEAR(smoothing_variance(origin, all, 1), 0.2 * 0.08 * 0.08, 1e-12);
    EXPECT_NEAR(smoothing_variance(origin, all, 4), 0.2 * 0.02 * 0.02, 1e-12);
    EXPECT_EQ(smoothing_variance(origin, all + 1, 1), 0) << "no view sees it";
    EXPECT_EQ(smoothing_variance(origin, all, 0), 0);
    const double nan = std::nan("");
    EXPECT_EQ(smoothing_variance(Vec3<double>{nan, 0, 0}, all, 4), 0);
}

/// The pixels per unit are those of the covariance on screen.
TEST(Smoothing, MeasuresPixelsThroughALens) {
    for (const TestLens& test : test_lenses()) {
        SCOPED_TRACE(test.name);
        const CameraParams<double> camera = lens_camera(test, 400, 300);
        for (const double share : {0.0, 0.3, 0.6}) {
            const double angle = share * test.lens.max_angle;
            const Vec3<double> cam{3 * std::sin(angle) * 0.8, 3 * std::sin(angle) * 0.6, 3 * std::cos(angle)};
            GaussianGeometry<double> g{};
            g.mean = camera.rotation.transposed_times(cam - camera.translation);
            g.log_scale = {std::log(0.01), std::log(0.01), std::log(0.01)};
            g.rotation = {1, 0, 0, 0};
            g.antialiased = true;
            Projection<double> p;
            ASSERT_TRUE(project_geometry(g, camera, p));
            const double rate = pixels_per_unit(g.mean, camera);
            FaceJacobian<double> on_screen(camera, p.at);
            on_screen.scale(1 / p.inclination);
            if (rate > 0) {  // the ball has this area in every direction
                const double area = std::sqrt(p.undilated_det) * std::abs(on_screen.det());
                EXPECT_NEAR(area / (0.01 * 0.01), rate * rate, 1e-6 * rate * rate);
            }
            EXPECT_TRUE(rate > 0 || share > 0.3);
        }
    }
}

TEST(Smoothing, BecomesPartOfTheModelWithoutAVisibleChange) {
    const auto camera = test_camera(48, 36);
    auto model = cast<float>(antialiased(random_gaussians(40, 0, 9)));
    model.appearance.model = "none";
    Pipeline<double, appearance::None> before, after;
    before.render(cast<double>(model), camera, {0.1, 0.2, 0.3});
    merge_smoothing(model);
    EXPECT_EQ(model[Group::kSmoothing].width, 0);
    EXPECT_TRUE(model[Group::kSmoothing].param.empty());
    EXPECT_TRUE(model.antialiased);
    after.render(cast<double>(model), camera, {0.1, 0.2, 0.3});
    for (std::size_t i = 0; i < before.image.size(); ++i) EXPECT_NEAR(before.image[i], after.image[i], 3e-6);
    auto again = model;
    merge_smoothing(again);
    EXPECT_EQ(again[Group::kScale].param, model[Group::kScale].param) << "there is nothing left to merge";
}

TEST(Smoothing, IsSetByTheBackendAndMergedInWhatItShows) {
    auto model = cast<float>(antialiased(random_gaussians(500, 0, 10)));
    model.appearance.model = "none", model.appearance.max_degree = 0;
    const std::vector<CameraParams<float>> cameras = {cast<float>(test_camera(48, 36)),
                                                      cast<float>(camera_before(6, 80, 48))};
    const auto backend = make_cpu_backend(model.appearance);
    backend->upload(model);
    backend->update_smoothing(cameras);
    auto now = backend->download(true);
    EXPECT_TRUE(now.antialiased);
    for (std::int64_t i = 0; i < now.count; ++i) {
        const float* m = &now[Group::kMean].param[3 * i];
        EXPECT_EQ(now[Group::kSmoothing].param[i],
                  smoothing_variance(Vec3<float>{m[0], m[1], m[2]}, cameras.data(), 2));
    }
    merge_smoothing(now);
    const Gaussians shown = backend->download(false);
    EXPECT_TRUE(shown.antialiased);
    EXPECT_EQ(shown[Group::kSmoothing].width, 0);
    EXPECT_EQ(shown[Group::kScale].param, now[Group::kScale].param);
    EXPECT_EQ(shown[Group::kOpacity].param, now[Group::kOpacity].param);

    // A training that begins with what was saved has the same parameters again.
    const Gaussians before = backend->download(true);
    Gaussians again = shown;
    add_smoothing(again, cameras);
    EXPECT_EQ(again[Group::kSmoothing].param, before[Group::kSmoothing].param);
    for (const Group group : {Group::kScale, Group::kOpacity})
        for (std::size_t i = 0; i < again[group].param.size(); ++i)
            EXPECT_NEAR(again[group].param[i], before[group].param[i], 2e-4) << kGroupNames[int(group)] << " " << i;
}

TEST(Smoothing, FirstGaussiansAreAsLargeAsTheirFilter) {
    auto model = cast<float>(random_gaussians(40, 0, 13));
    const std::vector<CameraParams<float>> cameras = {cast<float>(test_camera(48, 36))};
    for (std::int64_t i = 0; i < model.count; ++i)
        for (int k = 0; k < 3; ++k) model[Group::kScale].param[3 * i + k] = i % 2 ? -9 : 1;
    add_smoothing(model, cameras);
    EXPECT_TRUE(model.antialiased);
    int raised = 0;
    for (std::int64_t i = 0; i < model.count; ++i) {
        const float f2 = model[Group::kSmoothing].param[i], scale = model[Group::kScale].param[3 * i];
        const bool rises = i % 2 && f2 > 0;
        EXPECT_NEAR(scale, rises ? 0.5f * std::log(f2) : (i % 2 ? -9.0f : 1.0f), 1e-5);
        raised += rises;
    }
    EXPECT_GT(raised, 10);
}

TEST(Smoothing, OfRanksIsThatOfOne) {
    auto model = cast<float>(antialiased(random_gaussians(300, 0, 11)));
    model.appearance.model = "none", model.appearance.max_degree = 0;
    const std::vector<CameraParams<float>> cameras = {cast<float>(test_camera(48, 36))};
    const auto one = make_cpu_backend(model.appearance);
    const auto prepare = [&](Backend& backend) {
        backend.upload(model);
        backend.update_smoothing(cameras);
    };
    prepare(*one);
    const RenderRequest request{.camera = cameras[0]};
    RenderedImage expected;
    one->render(request, expected);
    with_ranked_backend(
        3, 3, {},
        [&](Backend& backend) {
            prepare(backend);
            RenderedImage image;
            backend.render(request, image);
            EXPECT_EQ(image.rgb, expected.rgb);
            const Gaussians all = backend.download(true);
            EXPECT_TRUE(all.antialiased);
            EXPECT_EQ(all[Group::kSmoothing].param, one->download(true)[Group::kSmoothing].param);
        },
        [&] { return make_cpu_engine(model.appearance); });
}

/// A Gaussian far smaller than its filter shows nothing, whatever its own opacity: densification must not keep it.
TEST(Smoothing, MakesTinyGaussiansDead) {
    auto model = cast<float>(antialiased(random_gaussians(30, 0, 12)));
    for (float& x : model[Group::kOpacity].param) x = 2;
    for (auto& group : model.groups) group.m.resize(group.param.size()), group.v.resize(group.param.size());
    for (const std::int64_t i : {3, 17})
        for (int k = 0; k < 3; ++k) model[Group::kScale].param[3 * i + k] = -9;
    auto relocated = model;
    EXPECT_EQ(mcmc_densify(relocated, McmcParams{.cap = 30}, 1, 2).relocated, 2);
    EXPECT_EQ(remove_invisible(model), 2);
}

/// The mean of each 2x2 pixels.
std::vector<double> halved(const std::vector<double>& image, int size) {
    std::vector<double> out;
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < size; y += 2)
            for (int x = 0; x < size; x += 2) {
                const double* p = &image[(std::size_t(c) * size + y) * size + x];
                out.push_back(0.25 * (p[0] + p[1] + p[size] + p[size + 1]));
            }
    return out;
}

/// Gaussians of about a pixel, as trainings make them, at half and at a quarter of the size. The large picture is the
/// same but for half the difference of the two dilations, so that only the smaller ones differ.
TEST(Antialiasing, SmallerPicturesAreNearerToTheMeanOfPixels) {
    auto plain = random_gaussians(3000, 0, 14);
    for (double& x : plain[Group::kMean].param) x *= 0.5;
    const int size = 64;
    const CameraParams<double> large = camera_before(4, 100, size);
    for (double& x : plain[Group::kScale].param) x = std::log(0.7 * 4 / 100) + 0.3 * std::tanh(x);
    auto filtered = plain;
    filtered.antialiased = true;
    const auto error = [&](const GaussianState<double>& s, int factor) {
        Pipeline<double, appearance::None> pipe;
        pipe.render(s, large, {0, 0, 0});
        std::vector<double> mean = pipe.image;
        for (int k = 1, side = size; k < factor; k *= 2, side /= 2) mean = halved(mean, side);
        CameraParams<double> small = large;
        small.fx /= factor, small.fy /= factor, small.cx /= factor, small.cy /= factor;
        small.width /= factor, small.height /= factor;
        pipe.render(s, small, {0, 0, 0});
        double sum = 0;
        for (std::size_t i = 0; i < mean.size(); ++i) sum += std::pow(pipe.image[i] - mean[i], 2);
        return std::sqrt(sum / double(mean.size()));
    };
    for (const int factor : {2, 4}) {
        const double without = error(plain, factor), with = error(filtered, factor);
        std::printf("1/%d of the size: error %.4f without, %.4f with antialiasing\n", factor, without, with);
        EXPECT_LT(with, 0.5 * without);
    }
}

TEST(Antialiasing, KeepsNeedlesAccurateInFloat) {
    const CameraParams<double> camera = camera_before(4, 2000, 2000);
    for (const double length : {0.1, 1.0, 10.0}) {
        GaussianGeometry<double> g{};
        g.mean = {0.1, -0.2, 0};
        g.log_scale = {std::log(length), std::log(2e-4), std::log(3e-4)};  // 1000s of pixels by a tenth of one
        g.rotation = {0.9, 0.1, -0.2, 0.4};
        g.antialiased = true;
        Projection<double> exact;
        ASSERT_TRUE(project_geometry(g, camera, exact));
        GaussianGeometry<float> f{{0.1f, -0.2f, 0},
                                  {float(g.log_scale.x), float(g.log_scale.y), float(g.log_scale.z)},
                                  {0.9f, 0.1f, -0.2f, 0.4f},
                                  0,
                                  0,
                                  true};
        Projection<float> p;
        ASSERT_TRUE(project_geometry(f, cast<float>(camera), p));
        EXPECT_NEAR(p.compensation, exact.compensation, 2e-5 * exact.compensation) << length;
    }
}

}  // namespace
}  // namespace gs::test
