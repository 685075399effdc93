// SPDX-License-Identifier: Apache-2.0
// Depths and normals of models whose surfaces are known.
#include "apps/gsapp/render/geometry_renderer.h"

#include <gtest/gtest.h>

#include <cmath>

#include "lib/scene/camera_params.h"
#include "tests/eval/support/tiny_run.h"

namespace gs {
namespace {

/// A Gaussian of the tests' models: its place, log scales, rotation and raw opacity.
struct Ball {
    Eigen::Vector3f mean;
    std::array<float, 3> scale = {-1.5f, -1.5f, -1.5f};
    std::array<float, 4> rotation = {1, 0, 0, 0};
    float opacity = 5;
};

Gaussians model_of(const std::vector<Ball>& balls) {
    Gaussians g;
    g.count = std::int64_t(balls.size());
    g.appearance = {"none", 0, ColorActivation::kSigmoid};
    g[Group::kMean].width = g[Group::kScale].width = g[Group::kBase].width = 3;
    g[Group::kRotation].width = 4, g[Group::kOpacity].width = 1;
    const auto add = [&](Group group, const auto& values) {
        g[group].param.insert(g[group].param.end(), values.begin(), values.end());
    };
    for (const Ball& ball : balls) {
        add(Group::kMean, std::array{ball.mean.x(), ball.mean.y(), ball.mean.z()});
        add(Group::kScale, ball.scale);
        add(Group::kRotation, ball.rotation);
        g[Group::kOpacity].param.push_back(ball.opacity);
        add(Group::kBase, std::array{0.1f, 0.2f, 0.3f});
    }
    return g;
}

SavedRun run_of(const test::TinyRun& saved, const std::vector<Ball>& balls, double frame_scale = 1) {
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    run.scene.frame.scale = frame_scale;
    run.backend->upload(model_of(balls));
    return run;
}

/// A camera in the origin that looks along +z. The middle of its middle pixel is on the axis.
Camera camera(int side = 21) {
    Camera c;
    c.width = c.height = side;
    c.fx = c.fy = 20, c.cx = c.cy = 0.5 * side;
    return c;
}

float middle(const std::vector<float>& values, int side = 21) {
    return values[std::size_t(side / 2) * std::size_t(side) + std::size_t(side / 2)];
}

double alpha_of(float raw) { return 1 / (1 + std::exp(-double(raw))); }

TEST(GeometryRenderer, DepthOfOneGaussianIsItsOwn) {
    const test::TinyRun saved;
    for (const float z : {0.25f, 1.7f, 3.3f, 127.9f, 128.1f, 900.f, 9000.f}) {
        const float size = std::log(0.1f * z);
        const SavedRun run = run_of(saved, {{{0, 0, z}, {size, size, size}}});
        const std::vector<float> depth = GeometryRenderer(run).depth(camera());
        int seen = 0;
        for (const float d : depth) {
            if (d == 0) continue;
            EXPECT_NEAR(d, z, 2e-6 * z);
            ++seen;
        }
        EXPECT_GT(seen, 20) << z;
        EXPECT_LT(seen, 21 * 21) << z << ": the corners see nothing";
        EXPECT_EQ(depth[0], 0);
    }
}

TEST(GeometryRenderer, DepthIsAlongTheAxisAndInSceneUnits) {
    const test::TinyRun saved;
    const SavedRun run = run_of(saved, {{{1, 0, 2}}}, 0.25);
    Camera c = camera();
    c.translation = {-1, 0, 1};  // the Gaussian is three frame units in front of it
    EXPECT_NEAR(middle(GeometryRenderer(run).depth(c)), 12, 1e-5) << "a scene unit is a quarter of the frame's";
    c.translation = {0, 0, 1};  // one to the right
    int seen = 0;
    for (const float d : GeometryRenderer(run).depth(c)) {
        if (d == 0) continue;
        EXPECT_NEAR(d, 12, 1e-5) << "not the distance from the camera";
        ++seen;
    }
    EXPECT_GT(seen, 0);
}

TEST(GeometryRenderer, DepthOfTwoGaussiansIsTheirMeanByWeight) {
    const test::TinyRun saved;
    // The second pair is on both sides of where the channels change.
    for (const auto& [z1, z2] : {std::pair{2.f, 5.f}, {100.f, 400.f}}) {
        const auto ball = [](float z, float opacity) {
            const float size = std::log(0.2f * z);
            return Ball{{0, 0, z}, {size, size, size}, {1, 0, 0, 0}, opacity};
        };
        SavedRun run = run_of(saved, {ball(z2, 0.7f), ball(z1, -0.5f)});
        const double a1 = alpha_of(-0.5f), a2 = alpha_of(0.7f), w2 = (1 - a1) * a2;
        EXPECT_NEAR(middle(GeometryRenderer(run).depth(camera())), (a1 * z1 + w2 * z2) / (a1 + w2), 2e-6 * z2);
        RenderedImage image;
        RenderRequest request;
        request.camera = camera_params(camera());
        run.backend->render(request, image);
        EXPECT_NEAR(middle(image.alpha), a1 + w2, 1e-6);
    }
}

TEST(GeometryRenderer, MedianDepthIsThatOfOneGaussian) {
    const test::TinyRun saved;
    const auto median = [&](const std::vector<Ball>& balls) {
        const SavedRun run = run_of(saved, balls);
        return GeometryRenderer(run).depth(camera(), DepthKind::kMedian);
    };
    const auto ball = [](float z, float opacity) {
        const float size = std::log(0.2f * z);
        return Ball{{0, 0, z}, {size, size, size}, {1, 0, 0, 0}, opacity};
    };
    // A stack of which each takes away 0.3 of the light: 0.7, then 0.49. The last two are over the channels' border.
    const float third = std::log(0.3f / 0.7f);
    for (const auto& [front, behind] : {std::pair{2.f, 5.f}, {100.f, 400.f}}) {
        EXPECT_NEAR(middle(median({ball(behind, third), ball(front, third), ball(2 * behind, 5)})), behind,
                    1e-6 * behind);
        EXPECT_NEAR(middle(median({ball(behind, third), ball(front, 0.1f)})), front, 1e-6 * front);
    }
    EXPECT_EQ(middle(median({ball(2, third)})), 0) << "more than half of the light comes from the background";
    EXPECT_EQ(median({ball(2, 5)})[0], 0) << "nothing is in the corner";
    EXPECT_EQ(median({})[0], 0);
}

TEST(GeometryRenderer, MedianDepthAtAnEdgeIsOnOneOfBothSurfaces) {
    const test::TinyRun saved;
    // A ball before a wall: the expected depth goes from one to the other in between.
    const SavedRun run = run_of(saved, {{{0, 0, 2}, {-1.5f, -1.5f, -1.5f}}, {{0, 0, 6}, {3, 3, -6}, {1, 0, 0, 0}, 6}});
    GeometryRenderer renderer(run);
    const std::vector<float> mean = renderer.depth(camera()), median = renderer.depth(camera(), DepthKind::kMedian);
    int near = 0, far = 0, between = 0;
    for (std::size_t i = 0; i < mean.size(); ++i) {
        near += std::abs(median[i] - 2) < 1e-5, far += std::abs(median[i] - 6) < 1e-5;
        between += mean[i] > 2.2 && mean[i] < 5.8;
    }
    EXPECT_EQ(near + far, 21 * 21);
    EXPECT_GT(near, 10);
    EXPECT_GT(far, 10);
    EXPECT_GT(between, 10);
}

TEST(GeometryRenderer, NormalsAreTheShortestAxesTurnedToTheCamera) {
    const test::TinyRun saved;
    const auto normal = [&](const Ball& ball, const Camera& c = camera()) {
        const SavedRun run = run_of(saved, {ball});
        const std::vector<float> n = GeometryRenderer(run).normals(c);
        const std::size_t at = 3 * (10 * 21 + 10);
        EXPECT_EQ(n[0] * n[0] + n[1] * n[1] + n[2] * n[2], 0) << "nothing is in the corner";
        return Eigen::Vector3f(n[at], n[at + 1], n[at + 2]);
    };
    const auto near = [](const Eigen::Vector3f& a, const Eigen::Vector3f& b) { return (a - b).norm() < 1e-5f; };
    EXPECT_TRUE(near(normal({{0, 0, 3}, {-1, -1, -4}}), {0, 0, -1}));
    EXPECT_TRUE(near(normal({{0, 0, 3}, {-1, -1, -4}, {0, 1, 0, 0}}), {0, 0, -1})) << "whatever its axis' sign";
    // 45 degrees about x turn z to (0, -1, 1) / sqrt 2; a quaternion need not have length 1.
    const float half = std::sqrt(0.5f), c = 3 * std::cos(float(M_PI) / 8), s = 3 * std::sin(float(M_PI) / 8);
    EXPECT_TRUE(near(normal({{0, 0, 3}, {-1, -1, -4}, {c, s, 0, 0}}), {0, half, -half}));
    // From behind, in the axes of the scene all the same.
    Camera behind = camera();
    behind.rotation = Eigen::Vector3d(-1, 1, -1).asDiagonal();
    behind.translation = {0, 0, 6};
    EXPECT_TRUE(near(normal({{0, 0, 3}, {-1, -1, -4}, {c, s, 0, 0}}, behind), {0, -half, half}));
    // Two faint Gaussians: the mean direction, of length 1.
    const SavedRun run =
        run_of(saved, {{{0, 0, 3}, {-1, -1, -4}, {1, 0, 0, 0}, -3}, {{0, 0, 4}, {-1, -1, -4}, {c, s, 0, 0}, -3}});
    const std::vector<float> n = GeometryRenderer(run).normals(camera());
    const float* at = &n[3 * (10 * 21 + 10)];
    const double a = alpha_of(-3), b = (1 - a) * a;
    const Eigen::Vector3d expected = Eigen::Vector3d(0, b * half, -a - b * half).normalized();
    EXPECT_NEAR(at[1], expected.y(), 1e-5);
    EXPECT_NEAR(at[2], expected.z(), 1e-5);
}

TEST(GeometryRenderer, EmptyAndOnePixelPictures) {
    const test::TinyRun saved;
    const SavedRun run = run_of(saved, {});
    GeometryRenderer nothing(run);
    for (const float d : nothing.depth(camera())) EXPECT_EQ(d, 0);
    for (const float n : nothing.normals(camera())) EXPECT_EQ(n, 0);
    EXPECT_EQ(nothing.depth(camera(1)), std::vector<float>{0});
    const SavedRun one = run_of(saved, {{{0, 0, 3}}, {{NAN, 0, 3}}, {{0, 0, -3}}});
    EXPECT_NEAR(GeometryRenderer(one).depth(camera(1))[0], 3, 1e-5) << "what is broken or behind is left out";
    EXPECT_EQ(GeometryRenderer(one).normals(camera(1)).size(), 3u);
}

}  // namespace
}  // namespace gs
