// SPDX-License-Identifier: Apache-2.0
// Initial Gaussians against brute force and the stated guards.
#include "lib/model/initialize.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "tests/io/file_helpers.h"

namespace gs::test {
namespace {

const AppearanceSpec kSh3{"sh", 3, ColorActivation::kRelu};

std::vector<Eigen::Vector3f> random_cloud(int n, unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<float> normal;
    std::vector<Eigen::Vector3f> points;
    for (int i = 0; i < n; ++i) points.emplace_back(normal(random), 3 * normal(random), 0.1f * normal(random));
    return points;
}

double brute_force_mean(const std::vector<Eigen::Vector3f>& points, std::size_t i) {
    std::vector<double> d;
    for (std::size_t j = 0; j < points.size(); ++j) {
        if (j != i) d.push_back((points[i].cast<double>() - points[j].cast<double>()).squaredNorm());
    }
    std::sort(d.begin(), d.end());
    const std::size_t n = std::min<std::size_t>(3, d.size());
    double sum = 0;
    for (std::size_t k = 0; k < n; ++k) sum += d[k];
    return n > 0 ? sum / double(n) : 0;
}

Scene scene_of(std::vector<Eigen::Vector3f> points) {
    Scene scene;
    scene.points.colors.assign(points.size(), Eigen::Vector3f(1, 0.25f, 0));
    scene.points.positions = std::move(points);
    scene.extent = 2;
    return scene;
}

TEST(Initialize, NeighborDistancesEqualBruteForce) {
    for (const int n : {1, 2, 3, 4, 5, 700}) {
        std::vector<Eigen::Vector3f> points = random_cloud(n, unsigned(n));
        if (n == 700) {
            for (int i = 0; i < 40; ++i)
                points[std::size_t(100 + i)] = points[5];  // more duplicates than neighbours asked for
            points[600] = points[601];
            points[602] *= 1e6f;
        }
        const std::vector<double> means = mean_squared_neighbor_distances(points);
        for (std::size_t i = 0; i < points.size(); ++i) {
            const double expected = brute_force_mean(points, i);
            EXPECT_NEAR(means[i], expected, 1e-12 * expected) << n << " points, point " << i;
        }
    }
}

TEST(Initialize, FromPointsFollowsTheFormulas) {
    const std::vector<Eigen::Vector3f> points = random_cloud(50, 3);
    const Scene scene = scene_of(points);
    for (const bool mcmc : {true, false}) {
        const Gaussians g = initialize_gaussians(scene, kSh3, {.mcmc = mcmc});
        ASSERT_EQ(g.count, 50);
        EXPECT_EQ(g.active_degree, 0);
        EXPECT_EQ(g.step, 0);
        EXPECT_EQ(g[Group::kResidual].width, 45);
        EXPECT_EQ(g[Group::kResidual].param, std::vector<float>(50 * 45, 0.0f));
        for (std::size_t i = 0; i < 50; ++i) {
            const double scale = std::sqrt(brute_force_mean(points, i)) * (mcmc ? 0.1 : 1);
            for (std::size_t c = 0; c < 3; ++c) {
                EXPECT_EQ(g[Group::kMean].param[3 * i + c], points[i][Eigen::Index(c)]);
                EXPECT_NEAR(g[Group::kScale].param[3 * i + c], std::log(scale), 1e-6);
            }
            EXPECT_EQ(std::vector<float>(&g[Group::kRotation].param[4 * i], &g[Group::kRotation].param[4 * i] + 4),
                      (std::vector<float>{1, 0, 0, 0}));
            EXPECT_NEAR(sigmoid(double(g[Group::kOpacity].param[i])), mcmc ? 0.5 : 0.1, 1e-7);
        }
        for (const auto& group : g.groups) EXPECT_TRUE(group.m.empty() && group.v.empty());
    }
}

TEST(Initialize, BaseColorShowsThePointColor) {
    for (int a = 0; a < 4; ++a) {
        const auto activation = ColorActivation(a);
        const Gaussians g = initialize_gaussians(scene_of(random_cloud(2, 1)), {"none", 0, activation}, {});
        const float* base = g[Group::kBase].param.data();
        EXPECT_NEAR(color_activation(activation, base[0]), 1 - 0.5 / 255, 1e-5);  // kept away from saturation
        EXPECT_NEAR(color_activation(activation, base[1]), 0.25, 1e-6);
        EXPECT_NEAR(color_activation(activation, base[2]), 0.5 / 255, 1e-5);
        EXPECT_EQ(g[Group::kResidual].width, 0);
    }
}

TEST(Initialize, GuardsAgainstDuplicatesLonePointsAndNonFiniteOnes) {
    const Gaussians duplicates = initialize_gaussians(scene_of({6, Eigen::Vector3f(1, 2, 3)}), kSh3, {.mcmc = false});
    EXPECT_NEAR(duplicates[Group::kScale].param[0], std::log(std::sqrt(1e-7)), 1e-6);
    const Gaussians lone = initialize_gaussians(scene_of({Eigen::Vector3f(1, 2, 3)}), kSh3, {});
    EXPECT_NEAR(lone[Group::kScale].param[2], std::log(0.02), 1e-6);
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const Gaussians kept =
        initialize_gaussians(scene_of({{0, 0, 0}, {nan, 0, 0}, {0, INFINITY, 0}, {1, 0, 0}}), kSh3, {.mcmc = false});
    ASSERT_EQ(kept.count, 2);
    EXPECT_NEAR(kept[Group::kScale].param[0], 0, 1e-6);
    EXPECT_THROW(initialize_gaussians(scene_of({{nan, nan, nan}}), kSh3, {}), DataError);
}

View camera_at(const Eigen::Vector3d& position) {
    View view;
    view.camera.width = 64, view.camera.height = 48;
    view.camera.fx = view.camera.fy = 100, view.camera.cx = 32, view.camera.cy = 24;
    view.camera.translation = -position;  // looks along +z
    return view;
}

TEST(Initialize, LobesPointAlongTheMeanDirectionFromTheCameras) {
    Scene scene = scene_of({{0, 0, 0}, {0, 0, 12}});
    scene.train = {camera_at({3, 0, 4}), camera_at({-3, 0, 4}), camera_at({0, 0, 5})};
    const ModelInfo& info = appearance_model("nasg");
    const AppearanceSpec nasg{"nasg", 1, ColorActivation::kRelu};
    const auto aimed = [&](const Vec3<double>& direction) {
        std::vector<float> row(std::size_t(info.residual_width(1)));
        info.init_residual(1, row.data());
        info.aim_residual(1, direction, row.data());
        return row;
    };
    const auto row = [&](const Gaussians& g, std::size_t i) {
        const auto begin = g[Group::kResidual].param.begin() + std::ptrdiff_t(i * g[Group::kResidual].width);
        return std::vector<float>(begin, begin + g[Group::kResidual].width);
    };
    const Gaussians g = initialize_gaussians(scene, nasg, {});
    EXPECT_EQ(row(g, 0), aimed({0, 0, -1}));
    EXPECT_EQ(row(g, 1), aimed({0, 0, 1})) << "each point has a direction of its own";
    scene.train = {camera_at({3, 0, 0}), camera_at({-3, 0, 0})};
    const Gaussians unseen = initialize_gaussians(scene_of({{0, 0, 0}, {0, 0, 12}}), nasg, {});
    std::vector<float> plain(std::size_t(info.residual_width(1)));
    info.init_residual(1, plain.data());
    scene.points.positions = {{0, 0, 0}, {1, 0, 0}};
    EXPECT_EQ(row(initialize_gaussians(scene, nasg, {}), 0), plain) << "seen from all sides alike";
    EXPECT_EQ(row(unseen, 0), plain) << "no cameras";
}

TEST(Initialize, RandomPointsLieInTheBoxAndInAFrustum) {
    Scene scene;
    scene.random_init_half_extent = 1.5;
    scene.train = {camera_at({0, 0, -4}), camera_at({0.5, 0, -3})};
    const PointCloud cloud = initial_points(scene, {.random_points = 20000, .seed = 3});
    // x/z and y/z limits of a camera at (x, 0, z): half the image over the focal length.
    const auto inside = [](const Eigen::Vector3f& p, double slack) {
        const auto by = [&](double x, double z) {
            return std::abs(p.x() - x) <= (0.32 + slack) * (p.z() - z) &&
                   std::abs(p.y()) <= (0.24 + slack) * (p.z() - z);
        };
        return by(0, -4) || by(0.5, -3);
    };
    std::mt19937 random(5);
    std::uniform_real_distribution<float> uniform(-1.5f, 1.5f);
    int num_inside = 0;
    for (int i = 0; i < 20000; ++i) {
        const float x = uniform(random), y = uniform(random), z = uniform(random);
        num_inside += inside({x, y, z}, 0);
    }
    // Two binomial counts with a standard deviation of 70 each: five of their difference.
    EXPECT_NEAR(double(cloud.positions.size()), num_inside, 500);
    Eigen::Vector3f low = cloud.positions[0], high = low;
    for (std::size_t i = 0; i < cloud.positions.size(); ++i) {
        const Eigen::Vector3f& p = cloud.positions[i];
        low = low.cwiseMin(p), high = high.cwiseMax(p);
        EXPECT_TRUE(inside(p, 1e-5));
        EXPECT_EQ(cloud.colors[i], Eigen::Vector3f::Constant(0.5f));
    }
    EXPECT_LE(high.maxCoeff(), 1.5f);
    EXPECT_GE(low.minCoeff(), -1.5f);
    EXPECT_GT(high.z() - low.z(), 2.9f);
    EXPECT_EQ(initial_points(scene, {.random_points = 20000, .seed = 3}).positions, cloud.positions);
    EXPECT_NE(initial_points(scene, {.random_points = 20000, .seed = 4}).positions, cloud.positions);
    EXPECT_EQ(initialize_gaussians(scene, kSh3, {.random_points = 20000, .seed = 3}).count,
              std::int64_t(cloud.positions.size()));
}

TEST(Initialize, RandomPointsBeyondTheFoldOfALensAreNotSeen) {
    // r (1 + 0.058 r^2 - 0.08 r^4) turns back at 53 degrees and has passed the centre again at 63.
    Scene scene;
    scene.random_init_half_extent = 1.5;
    View view = camera_at({0, 0, -2});
    view.camera.model = CameraModel::kOpenCV;
    view.camera.distortion = {0.058, -0.08};
    view.camera.range = lens_range(view.camera);
    scene.train = {view};
    const PointCloud cloud = initial_points(scene, {.random_points = 20000, .seed = 3});
    EXPECT_GT(cloud.positions.size(), 1000u);
    for (const Eigen::Vector3f& p : cloud.positions)
        EXPECT_LE(p.head<2>().norm(), 0.42f * (p.z() + 2)) << "the corner of the image";
}

TEST(Initialize, RealScenesWithoutPointsUseTheCameras) {
    Scene scene;
    scene.extent = 0.5;
    scene.train = {camera_at({10, 0, 0}), camera_at({11, 0, 0})};
    const PointCloud cloud = initial_points(scene, {.random_points = 5000});
    EXPECT_GT(cloud.positions.size(), 100u);
    for (const auto& p : cloud.positions) EXPECT_LE((p - Eigen::Vector3f(10.5f, 0, 0)).cwiseAbs().maxCoeff(), 1.5001f);
}

TEST(Initialize, NoVisibleRandomPointIsADataError) {
    Scene scene;
    scene.source = "here";
    scene.random_init_half_extent = 1;
    scene.train = {camera_at({0, 0, 50})};
    EXPECT_CONTAINS(message_of<DataError>([&] { initial_points(scene, {.random_points = 100}); }), "'here'");
}

}  // namespace
}  // namespace gs::test
