// SPDX-License-Identifier: Apache-2.0
// Rendering through lenses: the derivatives of each model, the covariance on screen against a Monte Carlo projection,
// and every gradient against central differences in double.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "appearance/none/none.h"
#include "tests/kernels/gradient_check.h"
#include "tests/kernels/lenses.h"

namespace gs::test {
namespace {

Vec3<double> direction_at(double angle, double azimuth) {
    return {std::sin(angle) * std::cos(azimuth), std::sin(angle) * std::sin(azimuth), std::cos(angle)};
}

TEST(Lens, DerivativesMatchFiniteDifferences) {
    for (const TestLens& test : test_lenses()) {
        SCOPED_TRACE(test.name);
        const Lens<double>& lens = test.lens;
        // On the axis, within the image, at the rim, and beyond it.
        for (const double angle : {0.0, 0.04, 0.5 * lens.max_angle, 0.99 * lens.max_angle, 1.05 * lens.max_angle})
            for (const double azimuth : {0.3, 2.5, 4.1}) {
                const Vec3<double> n = direction_at(angle, azimuth);
                Vec3<double> e1, e2;
                tangent_basis(n, e1, e2);
                const LensPoint<double> at = lens_point_at(lens, n, e1, e2);
                const auto point = [&](double a, double b) { return lens_point(lens, n + e1 * a + e2 * b); };
                const double h = 1e-4;
                const Vec2<double> o = point(0, 0);
                EXPECT_NEAR(at.x.value, o.x, 1e-12);
                EXPECT_NEAR(at.y.value, o.y, 1e-12);
                const auto check = [&](const Jet<double>& j, auto part) {
                    const double left = part(point(-h, 0)), right = part(point(h, 0)), up = part(point(0, -h)),
                                 down = part(point(0, h)), mid = part(o);
                    EXPECT_NEAR(j.x, (right - left) / (2 * h), 1e-6) << angle;
                    EXPECT_NEAR(j.y, (down - up) / (2 * h), 1e-6) << angle;
                    EXPECT_NEAR(j.xx, (right - 2 * mid + left) / (h * h), 1e-4) << angle;
                    EXPECT_NEAR(j.yy, (down - 2 * mid + up) / (h * h), 1e-4) << angle;
                    EXPECT_NEAR(j.xy,
                                (part(point(h, h)) - part(point(-h, h)) - part(point(h, -h)) + part(point(-h, -h))) /
                                    (4 * h * h),
                                1e-4)
                        << angle;
                };
                check(at.x, [](const Vec2<double>& p) { return p.x; });
                check(at.y, [](const Vec2<double>& p) { return p.y; });
            }
    }
}

TEST(Lens, ImagePointContinuesBeyondTheRim) {
    for (const TestLens& test : test_lenses()) {
        SCOPED_TRACE(test.name);
        for (const double azimuth : {0.0, 1.1, 3.9}) {
            double before = 0;
            for (int k = 0; k <= 40; ++k) {
                const double angle = (0.8 + 0.01 * k) * test.lens.max_angle;
                const Vec2<double> p = lens_point(test.lens, direction_at(angle, azimuth));
                const double radius = std::hypot(p.x, p.y);
                EXPECT_GT(radius, before) << angle;
                EXPECT_TRUE(k == 0 || radius - before < 0.2) << "no jump at " << angle;
                before = radius;
            }
        }
    }
}

/// Samples a small Gaussian, projects the samples through the lens and compares their moments with the splat's.
TEST(Lens, CovarianceOnScreenMatchesAMonteCarloProjection) {
    std::mt19937 rng(5);
    std::normal_distribution<double> normal;
    for (const TestLens& test : test_lenses()) {
        SCOPED_TRACE(test.name);
        const CameraParams<double> camera = lens_camera(test, 400, 300);
        for (const double share : {0.0, 0.4, 0.9}) {
            const double distance = 3, sigma = 0.01;
            const Vec3<double> cam = direction_at(share * test.lens.max_angle, 0.8) * distance;
            GaussianGeometry<double> g;
            g.mean = camera.rotation.transposed_times(cam - camera.translation);
            g.log_scale = {std::log(sigma), std::log(2 * sigma), std::log(0.5 * sigma)};
            g.rotation = {0.8, 0.3, -0.4, 0.2};
            g.raw_opacity = 0;
            Projection<double> p;
            ASSERT_TRUE(project_geometry(g, camera, p));
            const Mat3<double> r = rotation_matrix(g.rotation);
            constexpr int kSamples = 40000;
            double mx = 0, my = 0, xx = 0, xy = 0, yy = 0;
            for (int k = 0; k < kSamples; ++k) {
                const Vec3<double> local{sigma * normal(rng), 2 * sigma * normal(rng), 0.5 * sigma * normal(rng)};
                const Vec2<double> at = lens_point(camera.lens, camera_point(g.mean + r * local, camera));
                const double x = camera.fx * at.x, y = camera.fy * at.y;
                mx += x / kSamples, my += y / kSamples;
                xx += x * x / kSamples, xy += x * y / kSamples, yy += y * y / kSamples;
            }
            FaceJacobian<double> j(camera, p.at);
            j.scale(1 / p.inclination);
            const Sym2<double>& c = p.cov2d;
            const double on_screen[3] = {j.xx * j.xx * c.xx + 2 * j.xx * j.xy * c.xy + j.xy * j.xy * c.yy - kDilation,
                                         j.xx * j.yx * c.xx + (j.xx * j.yy + j.xy * j.yx) * c.xy + j.xy * j.yy * c.yy,
                                         j.yx * j.yx * c.xx + 2 * j.yx * j.yy * c.xy + j.yy * j.yy * c.yy - kDilation};
            const double scale = on_screen[0] + on_screen[2];
            EXPECT_NEAR(mx, camera.fx * p.at.x.value, 0.1 * std::sqrt(scale));
            EXPECT_NEAR(my, camera.fy * p.at.y.value, 0.1 * std::sqrt(scale));
            EXPECT_NEAR(xx - mx * mx, on_screen[0], 0.03 * scale);
            EXPECT_NEAR(xy - mx * my, on_screen[1], 0.03 * scale);
            EXPECT_NEAR(yy - my * my, on_screen[2], 0.03 * scale);
        }
    }
}

/// Returns the i-th Gaussian of a test, of random shape and rotation, about e^size large at a point of camera space.
GaussianGeometry<double> random_geometry(const CameraParams<double>& camera, const Vec3<double>& point, double size,
                                         int i, std::mt19937& rng) {
    std::normal_distribution<double> normal;
    GaussianGeometry<double> g;
    g.mean = camera.rotation.transposed_times(point - camera.translation);
    g.log_scale = {size + 0.5 * normal(rng), size + 0.5 * normal(rng), size - 2 + 2 * normal(rng)};
    g.rotation = {normal(rng), normal(rng), normal(rng), normal(rng)};
    g.raw_opacity = i % 3 == 0 ? 6 : -2.0 + normal(rng);
    return g;
}

/// Every pixel that a splat reaches lies in its outline and in its bounds, whatever the lens, the place and the size.
TEST(Lens, OutlinesHoldAllPixelsThatSplatsReach) {
    std::mt19937 rng(29);
    std::vector<TestLens> lenses = test_lenses();
    lenses.push_back(equirectangular_lens());
    for (std::size_t i = lenses.size(); i-- > 0;) lenses.push_back(drawn_as_pinholes(lenses[i]));
    constexpr int kWidth = 96, kHeight = 64;
    for (const TestLens& test : lenses) {
        SCOPED_TRACE(test.name);
        CameraParams<double> camera = lens_camera(test, kWidth, kHeight);
        if (!test.lens.wraps()) camera.cx = 0.5 * kWidth, camera.cy = 0.5 * kHeight;
        std::vector<Vec3<double>> rays;
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x)
                rays.push_back(
                    lens_ray(camera.lens, (x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy));
        std::int64_t reached = 0, in_outline = 0;
        for (int i = 0; i < 1200; ++i) {
            const double share = 1.15 * double(i) / 1200, distance = 3;
            const Vec3<double> direction = test.lens.wraps() ? direction_at(M_PI * double(i) / 1200, 2.1 * i)
                                                             : direction_at(share * test.lens.max_angle, 2.1 * i);
            const Vec3<double> cam =
                test.lens.wraps() ? Vec3<double>{direction.x, direction.z, direction.y} : direction;
            const double size = -5 + 5.5 * double(i % 23) / 22;  // up to half a radian and more
            const GaussianGeometry<double> g = random_geometry(camera, cam * distance, size, i, rng);
            Splat<double> s;
            PixelBounds b;
            double depth;
            LensShape<double> shape;
            const int padded_height = (kHeight + 15) / 16 * 16;
            const bool drawn = make_splat(g, camera, kWidth, padded_height, s, b, depth, {}, &shape);
            if (!drawn) continue;
            for (int y = 0; y < kHeight; ++y)
                for (int x = 0; x < kWidth; ++x) {
                    const FaceRay<double> ray = face_ray(rays[std::size_t(y) * kWidth + x], shape.axis,
                                                         camera.face_focal(), camera.lens.as_pinholes);
                    const double alpha = lens_fragment_alpha<double>(shape, s.opacity, ray).alpha;
                    const double mx =
                        camera.lens.wraps() ? nearest_repeat(s.mean.x, x + 0.5, camera.period()) : s.mean.x;
                    const double dx = mx - (x + 0.5), dy = s.mean.y - (y + 0.5);
                    const bool inside = 0.5 * (s.a * dx * dx + s.c * dy * dy) + s.b * dx * dy <= touch_threshold(s);
                    const bool in_columns =
                        (x >= b.x_min && x < b.x_max) || (x + kWidth >= b.x_min && x + kWidth < b.x_max);
                    in_outline += inside;
                    if (alpha < kMinAlpha) continue;
                    ++reached;
                    ASSERT_TRUE(inside) << i << ": " << x << ", " << y << " size " << size << " alpha " << alpha;
                    ASSERT_TRUE(in_columns && y >= b.y_min && y < b.y_max) << i << ": " << x << ", " << y;
                }
        }
        EXPECT_GT(reached, 10000);
        std::printf("%s%s: outlines are %.2f times what is reached\n", test.name,
                    test.lens.as_pinholes ? " as pinholes" : "", double(in_outline) / double(reached));
    }
}

/// A splat that is not wide reaches no ray of the other half of the sphere in any tile that its outline touches, so
/// that blending need not compare.
TEST(Lens, NarrowSplatsMeetNoOppositeRays) {
    std::mt19937 rng(31);
    std::vector<TestLens> lenses = test_lenses();
    lenses.push_back(equirectangular_lens());
    for (std::size_t i = lenses.size(); i-- > 0;) lenses.push_back(drawn_as_pinholes(lenses[i]));
    for (const TestLens& test : lenses) {
        SCOPED_TRACE(test.name);
        int num_narrow = 0;
        for (const int width : {512, 256}) {
            const int height = width / 2;
            constexpr int kStep = 4, kTile = kTileWidth;
            const CameraParams<double> camera = lens_camera(test, width, height);
            std::vector<Vec3<double>> rays;
            for (int y = 0; y < height; y += kStep)
                for (int x = 0; x < width; x += kStep)
                    rays.push_back(
                        lens_ray(camera.lens, (x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy));
            for (int i = 0; i < 300; ++i) {
                const double angle = (test.lens.wraps() ? M_PI : std::acos(test.lens.cos_drawn)) * double(i) / 300;
                const double size = -4 + 4.5 * double(i % 23) / 22;
                const GaussianGeometry<double> g =
                    random_geometry(camera, direction_at(angle, 2.1 * i) * 3.0, size, i, rng);
                Splat<double> s;
                PixelBounds b;
                double depth;
                LensShape<double> shape;
                if (!make_splat(g, camera, width, height, s, b, depth, {}, &shape) || shape.wide) continue;
                ++num_narrow;
                std::vector<bool> touched(std::size_t(width / kTile) * (height / kTile));
                std::vector<int> opposite;
                for (int y = 0, k = 0; y < height; y += kStep)
                    for (int x = 0; x < width; x += kStep, ++k) {
                        const int tile = y / kTile * (width / kTile) + x / kTile;
                        const double mx =
                            camera.lens.wraps() ? nearest_repeat(s.mean.x, x + 0.5, camera.period()) : s.mean.x;
                        const double dx = mx - (x + 0.5), dy = s.mean.y - (y + 0.5);
                        if (0.5 * (s.a * dx * dx + s.c * dy * dy) + s.b * dx * dy <= touch_threshold(s))
                            touched[tile] = true;
                        const FaceRay<double> ray =
                            face_ray(rays[k], shape.axis, camera.face_focal(), camera.lens.as_pinholes);
                        const double forward =
                            shape.forward.x * ray.x + shape.forward.y * ray.y + shape.forward.z * ray.w;
                        if (forward < 1e-3 && lens_fragment_alpha<double>(shape, s.opacity, ray).alpha >= kMinAlpha)
                            opposite.push_back(tile);
                    }
                for (const int tile : opposite) ASSERT_FALSE(touched[tile]) << i << ": tile " << tile;
            }
        }
        EXPECT_GT(num_narrow, 100);
    }
}

TEST(Lens, RaysAreThoseOfTheImagePoints) {
    for (const TestLens& test : test_lenses())
        for (const double share : {0.0, 0.1, 0.7, 1.0, 1.2})
            for (const double azimuth : {0.2, 3.0, 5.0}) {
                const Vec3<double> d = direction_at(share * test.lens.max_angle, azimuth);
                const Vec2<double> p = lens_point(test.lens, d);
                const Vec3<double> ray = lens_ray(test.lens, p.x, p.y);
                const Vec3<double> off = ray - d;
                EXPECT_LT(std::sqrt(dot(off, off)), 1e-9) << test.name << " " << share;
            }
}

/// Gaussians all over the image, some at its rim, some just outside.
GaussianState<double> gaussians_before(const TestLens& test, const CameraParams<double>& camera, std::uint32_t seed) {
    auto s = random_gaussians(9, 0, seed);
    for (int i = 0; i < 9; ++i) {
        const double share[] = {0, 0.02, 0.3, 0.6, 0.8, 0.95, 0.99, 1.01, 1.1};
        const Vec3<double> cam = direction_at(share[i] * test.lens.max_angle, 0.4 + 0.7 * i) * (3 + 0.2 * i);
        const Vec3<double> mean = camera.rotation.transposed_times(cam - camera.translation);
        double* m = &s[Group::kMean].param[3 * i];
        m[0] = mean.x, m[1] = mean.y, m[2] = mean.z;
        for (int k = 0; k < 3; ++k) s[Group::kScale].param[3 * i + k] -= 0.3;
    }
    return s;
}

TEST(LensGradient, MatchesFiniteDifferencesForEveryModelOfLens) {
    for (const TestLens& test : test_lenses()) {
        SCOPED_TRACE(test.name);
        const CameraParams<double> camera = lens_camera(test, 36, 28);
        GradientCheck check;
        check.tolerance = 1e-5;
        check.run<appearance::None>(gaussians_before(test, camera, 3), camera, {0.2, 0.7, 0.4},
                                    random_weights(3 * 36 * 28, 8));
        EXPECT_EQ(check.checked, 9 * 14);
        EXPECT_GT(check.nonzero, 60);
        check.run<appearance::None>(antialiased(gaussians_before(test, camera, 3)), camera, {0.2, 0.7, 0.4},
                                    random_weights(3 * 36 * 28, 8));
        CameraParams<double> pinholes = camera;
        pinholes.lens.as_pinholes = true;
        check.run<appearance::None>(gaussians_before(test, camera, 3), pinholes, {0.2, 0.7, 0.4},
                                    random_weights(3 * 36 * 28, 8));
        check.run<appearance::None>(antialiased(gaussians_before(test, camera, 3)), pinholes, {0.2, 0.7, 0.4},
                                    random_weights(3 * 36 * 28, 8));
        std::printf("%s: worst relative error %.2e, of the pose %.2e\n", test.name, check.worst, check.worst_of_camera);
    }
}

TEST(LensGradient, OfTheLensMatchesForSmallSplats) {
    for (const TestLens& test : test_lenses()) {
        SCOPED_TRACE(test.name);
        const CameraParams<double> camera = lens_camera(test, 360, 280);
        GaussianState<double> s = gaussians_before(test, camera, 5);
        for (double& x : s[Group::kScale].param) x -= 2.5;
        GradientCheck check;
        check.only_camera = true, check.tolerance = 1e-5, check.lens_tolerance = 0.03;
        check.run<appearance::None>(s, camera, {0.2, 0.7, 0.4},
                                    random_weights(std::size_t(3 * camera.width * camera.height), 8));
        std::printf("%s: error of the camera's gradient %.2e\n", test.name, check.worst_of_camera);
    }
}

TEST(LensGradient, MatchesWithViewDependentColour) {
    const TestLens& fisheye = test_lenses().front();
    const CameraParams<double> camera = lens_camera(fisheye, 30, 24);
    auto s = random_gaussians(9, 2, 6);
    const auto geometry = gaussians_before(fisheye, camera, 6);
    s[Group::kMean].param = geometry[Group::kMean].param;
    GradientCheck check;
    check.tolerance = 1e-5;
    check.run<appearance::Sh>(s, camera, {0, 0, 0}, random_weights(3 * 30 * 24, 4));
}

TEST(Lens, WithoutDistortionDrawsWhatAPinholeDraws) {
    // SIMPLE_RADIAL without distortion is a pinhole.
    CameraParams<double> pinhole = test_camera(48, 36), lens = pinhole;
    lens.lens = {.model = CameraModel::kSimpleRadial, .max_angle = 1.2, .slope = 1};
    lens.lens.sin_max = std::sin(1.2), lens.lens.cos_max = lens.lens.cos_drawn = std::cos(1.2);
    auto one = random_gaussians(12, 0, 2);
    for (int i = 1; i < 12; ++i) one[Group::kOpacity].param[i] = -50;  // one Gaussian: no order
    for (const auto& [log_scale, tolerance] : {std::pair{-3.0, 2e-3}, std::pair{-7.0, 1e-3}}) {
        // Both are right to first order in the Gaussian's extent; the dilation leaves 0.5 pixels.
        std::fill_n(one[Group::kScale].param.begin(), 3, log_scale);
        Pipeline<double, appearance::None> a, b;
        a.render(one, pinhole, {0, 0, 0});
        b.render(one, lens, {0, 0, 0});
        double brightest = 0;
        for (std::size_t i = 0; i < a.image.size(); ++i) {
            ASSERT_NEAR(a.image[i], b.image[i], tolerance);
            brightest = std::max(brightest, a.image[i]);
        }
        EXPECT_GT(brightest, 0.03);
    }
    lens.lens.as_pinholes = true;
    const auto weights = random_weights(3 * 48 * 36, 1);
    for (const bool filtered : {false, true}) {
        auto s = random_gaussians(12, 0, 2);
        if (filtered) s = antialiased(s);
        for (int i = 0; i < 12; ++i) {  // beyond the margin the pinhole's Jacobian is clipped
            const double* m = &s[Group::kMean].param[3 * i];
            const Vec3<double> p = camera_point(Vec3<double>{m[0], m[1], m[2]}, pinhole);
            const bool inside =
                std::abs(p.x) < 0.6 * p.z * 48 / pinhole.fx && std::abs(p.y) < 0.6 * p.z * 36 / pinhole.fy;
            if (!inside) s[Group::kOpacity].param[i] = -50;
        }
        Pipeline<double, appearance::None> a, b;
        a.render(s, pinhole, {0.1, 0.2, 0.3});
        b.render(s, lens, {0.1, 0.2, 0.3});
        for (std::size_t i = 0; i < a.image.size(); ++i) ASSERT_NEAR(a.image[i], b.image[i], 1e-9);
        const auto ga = a.gradients(s, weights), gb = b.gradients(s, weights);
        double largest = 0;
        for (const Group group : {Group::kMean, Group::kScale, Group::kRotation, Group::kOpacity, Group::kBase})
            for (std::size_t i = 0; i < ga[group].param.size(); ++i) {
                const double x = ga[group].param[i];
                ASSERT_NEAR(x, gb[group].param[i], 1e-7 * (1 + std::abs(x))) << int(group) << " " << i;
                largest = std::max(largest, std::abs(x));
            }
        EXPECT_GT(largest, 0.1);
    }
}

TEST(Lens, OrdersGaussiansByDistanceOrAsPinholesDo) {
    CameraParams<double> pinhole = test_camera(48, 36), lens = pinhole;
    pinhole.rotation = lens.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    pinhole.translation = pinhole.position = lens.translation = lens.position = {0, 0, 0};
    lens.lens = {.model = CameraModel::kSimpleRadial, .max_angle = 1.2, .slope = 1};
    lens.lens.sin_max = std::sin(1.2), lens.lens.cos_max = lens.lens.cos_drawn = std::cos(1.2);
    // The second is farther along the axis of the camera, and nearer.
    auto s = random_gaussians(2, 0, 2);
    const double means[6] = {1.0, 0.7, 2.0, 0.985, 0.69, 2.002};
    ASSERT_LT(std::hypot(means[3], means[4], means[5]), std::hypot(means[0], means[1], means[2]));
    std::copy_n(means, 6, s[Group::kMean].param.begin());
    std::fill_n(s[Group::kScale].param.begin(), 6, -2.8);
    std::fill_n(s[Group::kOpacity].param.begin(), 2, 3);
    const double colors[6] = {2, 0, 0, 0, 0, 2};
    std::copy_n(colors, 6, s[Group::kBase].param.begin());
    const auto worst_difference = [&](bool as_pinholes) {
        lens.lens.as_pinholes = as_pinholes;
        Pipeline<double, appearance::None> a, b;
        a.render(s, pinhole, {0, 0, 0});
        b.render(s, lens, {0, 0, 0});
        double worst = 0;
        for (std::size_t i = 0; i < a.image.size(); ++i) worst = std::max(worst, std::abs(a.image[i] - b.image[i]));
        return worst;
    };
    EXPECT_GT(worst_difference(false), 0.15) << "by distance";
    EXPECT_LT(worst_difference(true), 1e-9);
    // The near plane is a pinhole's, too.
    CameraParams<double> near = lens;
    near.near_plane = 2.1;
    Projection<double> p;
    GaussianGeometry<double> g{
        .mean = {1.0, 0.7, 2.0}, .log_scale = {-3, -3, -3}, .rotation = {1, 0, 0, 0}, .raw_opacity = 0};
    EXPECT_FALSE(project_geometry(g, near, p));
    near.lens.as_pinholes = false;
    EXPECT_TRUE(project_geometry(g, near, p));
    // Beside and behind the camera the pinholes look along other axes.
    lens.lens.as_pinholes = true;
    EXPECT_EQ(depth_of(Vec3<double>{-3, 1, 2}, lens), 3);
    EXPECT_EQ(depth_of(Vec3<double>{1, 4, -2}, lens), 4);
    EXPECT_EQ(depth_of(Vec3<double>{1, 4, -5}, lens), 5);
}

/// Turning the camera about its vertical axis moves a 360-degree image sideways, across the seam.
TEST(Lens, TheSeamOfA360DegreeImageIsNoEdge) {
    for (const int width : {64, 72}) {  // with and without a tile that the border cuts
        CameraParams<double> camera = lens_camera(equirectangular_lens(), width, 32);
        camera.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
        camera.translation = camera.position = {0, 0, 0};
        auto s = random_gaussians(40, 0, 17);
        for (int i = 0; i < 40; ++i) {
            const double azimuth = 2 * M_PI * (i + 0.3) / 40, latitude = 0.02 * (i % 9 - 4) * 5;
            double* m = &s[Group::kMean].param[3 * i];
            const double r = 2 + 0.05 * i;
            m[0] = r * std::cos(latitude) * std::sin(azimuth), m[1] = r * std::sin(latitude);
            m[2] = r * std::cos(latitude) * std::cos(azimuth);
        }
        Pipeline<double, appearance::None> straight, turned;
        straight.render(s, camera, {0.1, 0.2, 0.3});
        const int shift = 23;
        const double angle = 2 * M_PI * shift / width, c = std::cos(angle), n = std::sin(angle);
        camera.rotation = {{c, 0, n}, {0, 1, 0}, {-n, 0, c}};
        turned.render(s, camera, {0.1, 0.2, 0.3});
        for (int channel = 0; channel < 3; ++channel)
            for (int y = 0; y < 32; ++y)
                for (int x = 0; x < width; ++x) {
                    const std::size_t row = (std::size_t(channel) * 32 + y) * width;
                    ASSERT_NEAR(straight.image[row + x], turned.image[row + (x + shift) % width], 1e-9)
                        << x << " " << y;
                }
    }
}

TEST(Lens, APoleOrAHugeGaussianInA360DegreeImageIsFinite) {
    CameraParams<double> camera = lens_camera(equirectangular_lens(), 64, 32);
    camera.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    camera.translation = camera.position = {0, 0, 0};
    for (const double log_scale : {-6.0, -2.0, 0.0, 4.0, 30.0})
        for (const double offset : {0.0, 1e-9, 1e-3, 0.3}) {
            auto s = random_gaussians(2, 0, 3);
            const double means[6] = {offset, -2, 0, 0, 3, offset};
            std::copy_n(means, 6, s[Group::kMean].param.begin());
            std::fill_n(s[Group::kScale].param.begin(), 6, log_scale);
            Pipeline<double, appearance::None> pipe;
            pipe.render(s, camera, {0.1, 0.2, 0.3});
            for (const double x : pipe.image) ASSERT_TRUE(std::isfinite(x)) << log_scale << " " << offset;
            for (const auto& group : pipe.gradients(s, random_weights(3 * 64 * 32, 1)).groups)
                for (const double x : group.param) ASSERT_TRUE(std::isfinite(x)) << log_scale << " " << offset;
        }
}

TEST(LensGradient, MatchesFiniteDifferencesAcrossTheSeam) {
    CameraParams<double> camera = lens_camera(equirectangular_lens(), 40, 20);
    camera.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    camera.translation = camera.position = {0, 0, 0};
    auto s = random_gaussians(5, 0, 23);
    for (int i = 0; i < 5; ++i) {
        const double azimuth = M_PI + 0.05 * (i - 2), latitude = 0.3 * (i - 2);
        double* m = &s[Group::kMean].param[3 * i];
        m[0] = 3 * std::cos(latitude) * std::sin(azimuth), m[1] = 3 * std::sin(latitude);
        m[2] = 3 * std::cos(latitude) * std::cos(azimuth);
    }
    GradientCheck check;
    check.tolerance = 1e-5;
    check.run<appearance::None>(s, camera, {0.2, 0.7, 0.4}, random_weights(3 * 40 * 20, 8));
    EXPECT_GT(check.nonzero, 60);
}

TEST(Lens, SplatsInFloatAgreeWithThoseInDouble) {
    for (const TestLens& test : test_lenses()) {
        SCOPED_TRACE(test.name);
        const CameraParams<double> camera = lens_camera(test, 120, 90);
        auto s = random_gaussians(9, 0, 12);
        s[Group::kMean].param = gaussians_before(test, camera, 1)[Group::kMean].param;
        Pipeline<double, appearance::None> exact;
        Pipeline<float, appearance::None> production;
        exact.render(s, camera, {0.1, 0.2, 0.3});
        production.render(cast<float>(s), cast<float>(camera), {0.1f, 0.2f, 0.3f});
        double worst = 0, sum = 0;
        for (std::size_t i = 0; i < exact.image.size(); ++i) {
            const double error = std::abs(exact.image[i] - double(production.image[i]));
            worst = std::max(worst, error), sum += error / double(exact.image.size());
        }
        EXPECT_LT(sum, 2e-6);
        EXPECT_LT(worst, 5e-3) << "at most a fragment at the cutoff";
    }
}

}  // namespace
}  // namespace gs::test
