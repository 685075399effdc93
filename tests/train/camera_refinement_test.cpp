// SPDX-License-Identifier: Apache-2.0
// Learned cameras: derivatives, coordinates in pixels, the gauge, tracks, and what a run does with them.
#include "lib/train/camera_refinement.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <functional>
#include <random>

#include "lib/core/options.h"
#include "lib/core/progress.h"
#include "lib/model/cameras_json.h"
#include "lib/model/run_folder.h"
#include "lib/scene/procedural.h"
#include "lib/train/trainer.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

using Eigen::Vector2d, Eigen::Vector3d;

Vector6d random_way(std::mt19937& rng, double size) {
    std::normal_distribution<double> normal;
    Vector6d way;
    for (int k = 0; k < 6; ++k) way[k] = size * normal(rng);
    return way;
}

Camera some_camera(CameraModel model) {
    Camera camera;
    camera.model = model;
    camera.width = 200, camera.height = 150;
    camera.fx = 160, camera.fy = 150, camera.cx = 103, camera.cy = 70;
    if (model == CameraModel::kOpenCVFisheye) camera.distortion = {-0.03, 0.004, -0.001, 0.0002};
    if (model == CameraModel::kOpenCV) camera.distortion = {0.1, -0.05, 0.003, -0.002};
    camera.range = is_pinhole(camera) ? LensRange{} : lens_range(camera);
    camera.rotation = Eigen::AngleAxisd(0.4, Vector3d(1, 2, -0.5).normalized()).toRotationMatrix();
    camera.translation = {0.2, -0.1, 4};
    return camera;
}

std::vector<Vector3d> points_before(const Camera& camera, int count) {
    std::mt19937 rng(5);
    std::uniform_real_distribution<double> uniform(-1, 1);
    std::vector<Vector3d> points;
    for (int k = 0; k < count; ++k) {
        const double depth = 4 + 2 * uniform(rng);
        const Vector3d in_camera(0.5 * depth * uniform(rng), 0.4 * depth * uniform(rng), depth);
        points.push_back(camera.rotation.transpose() * (in_camera - camera.translation));
    }
    return points;
}

/// Returns where a camera shows points.
std::vector<PointObservation> shown(const Camera& camera, const std::vector<Vector3d>& points) {
    std::vector<PointObservation> out;
    for (const Vector3d& point : points)
        if (const auto pixel = pixel_of(camera, camera.rotation * point + camera.translation))
            out.push_back({point, {pixel->at.x() / camera.width, pixel->at.y() / camera.height}});
    return out;
}

TEST(CameraRefinement, TracksHaveTheGradientOfTheirError) {
    for (const CameraModel model : {CameraModel::kPinhole, CameraModel::kOpenCV, CameraModel::kOpenCVFisheye}) {
        SCOPED_TRACE(int(model));
        const Camera truth = some_camera(model);
        const auto seen = shown(truth, points_before(truth, 30));
        std::mt19937 rng(1);
        const Camera camera = moved_by(truth, random_way(rng, 0.01));
        const TrackError error = track_error(camera, seen);
        EXPECT_GT(error.mean, 0.1);
        for (int k = 0; k < (is_pinhole(camera) ? 9 : 10); ++k) {
            const auto mean_at = [&](double h) {
                Camera moved = camera;
                if (k < 6) moved = moved_by(camera, h * Vector6d::Unit(k));
                if (k == 6) moved.fx *= std::exp(h), moved.fy *= std::exp(h);
                if (k == 7) moved.cx += h;
                if (k == 8) moved.cy += h;
                if (k == 9) moved.distortion[0] += h;
                return track_error(moved, seen).mean;
            };
            const double h = 1e-6, difference = (mean_at(h) - mean_at(-h)) / (2 * h);
            EXPECT_NEAR(difference, error.gradient[k], 1e-4 * error.gradient.norm()) << k;
        }
    }
}

TEST(CameraRefinement, AUnitOfAWayIsAPixel) {
    const Camera camera = some_camera(CameraModel::kPinhole);
    const std::vector<Vector3d> points = points_before(camera, 400);
    const PoseLearner pose(camera, points);
    std::mt19937 rng(2);
    for (int k = 0; k < 10; ++k) {
        const Vector6d way = random_way(rng, 0.05);
        const Camera moved = pose.moved(camera, way);
        EXPECT_LT((pose.way_to(moved) - way).norm(), 1e-3 * way.norm()) << "to the first order of the turn";
        double sum = 0, count = 0;
        for (const Vector3d& point : points) {
            const auto a = pixel_of(camera, camera.rotation * point + camera.translation),
                       b = pixel_of(moved, moved.rotation * point + moved.translation);
            if (a->at.x() < 0 || a->at.y() < 0 || a->at.x() >= camera.width || a->at.y() >= camera.height) continue;
            sum += (a->at - b->at).squaredNorm(), ++count;
        }
        // Directions in which points hardly move are shorter than they seem, so that they take no long ways.
        EXPECT_LT(std::sqrt(sum / count), 1.05 * way.norm());
        EXPECT_GT(std::sqrt(sum / count), 0.3 * way.norm());
    }
}

TEST(CameraRefinement, StepsGoDownhillWithinTheirBounds) {
    const Camera truth = some_camera(CameraModel::kPinhole);
    const std::vector<Vector3d> points = points_before(truth, 100);
    const auto seen = shown(truth, points);
    std::mt19937 rng(3);
    const Camera given = moved_by(truth, random_way(rng, 0.005));
    PoseLearner pose(given, points);
    Camera camera = given;
    const double before = track_error(camera, seen).mean;
    for (int k = 0; k < 200; ++k)
        pose.step(camera, track_error(camera, seen).gradient.head<6>(), 0.1 * (1 - k / 200.0), 0, 20);
    EXPECT_LT(track_error(camera, seen).mean, 0.01 * before);
    for (int k = 0; k < 50; ++k) pose.step(camera, Vector6d::Constant(1e3), 1, 0, 2);
    EXPECT_NEAR(pose.way_to(camera).norm(), 2, 0.01);
    const Camera held = camera;
    pose.step(camera, Vector6d::Constant(std::nan("")), 1, 0, 2);
    EXPECT_EQ(camera.translation, held.translation);
}

TEST(CameraRefinement, APullBalancesTheGradientAndDoesNotOvershoot) {
    const Camera given = some_camera(CameraModel::kPinhole);
    const PoseLearner start(given, points_before(given, 100));
    const Vector6d minimum = Vector6d::Constant(0.2);
    for (const double pull : {0.0, 0.01, 0.04, 100.0}) {
        SCOPED_TRACE(pull);
        constexpr double kCurvature = 0.02;
        PoseLearner pose = start;
        Camera camera = given;
        for (int k = 0; k < 400; ++k) {
            const Vector6d way = pose.way_to(camera);
            ASSERT_LT(way.norm(), 1) << "after " << k << " steps";
            const Vector6d by_pixels = kCurvature * (way - minimum);
            Vector6d gradient;  // the same by turn and shift
            for (int i = 0; i < 6; ++i)
                gradient[i] = by_pixels.dot(pose.way_to(moved_by(given, 1e-6 * Vector6d::Unit(i)))) / 1e-6;
            pose.step(camera, gradient, 0.05 * (1 - k / 400.0), pull, 20);
        }
        const Vector6d expected = minimum * (kCurvature / (kCurvature + pull));
        EXPECT_LT((pose.way_to(camera) - expected).norm(), 0.02);
    }
}

TEST(CameraRefinement, SimilarityIsFoundFromTheCameras) {
    std::mt19937 rng(4);
    std::vector<Camera> given, now;
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.3, Vector3d(1, -1, 2).normalized()).toRotationMatrix();
    for (int k = 0; k < 7; ++k) {
        given.push_back(moved_by(some_camera(CameraModel::kPinhole), random_way(rng, 0.5)));
        Camera camera = given.back();
        const Vector3d center = 1.25 * (turn * camera.center()) + Vector3d(1, 2, 3);
        camera.rotation = camera.rotation * turn.transpose();
        camera.translation = -(camera.rotation * center);
        now.push_back(camera);
    }
    const Similarity found = similarity_of(given, now);
    EXPECT_LT((found.rotation - turn).norm(), 1e-9);
    EXPECT_NEAR(found.scale, 1.25, 1e-9);
    EXPECT_LT((found.shift - Vector3d(1, 2, 3)).norm(), 1e-8);
    const Similarity one_place = similarity_of({given[0], given[0]}, {now[0], now[0]});
    EXPECT_EQ(one_place.scale, 1);
}

Scene small_scene(double off_by, bool with_tracks, std::uint32_t seed = 6) {
    SceneOptions options;
    options.resolution = 64, options.eval = true;
    Scene scene = load_builtin_scene("diffuse", options);
    scene.train.resize(12), scene.test.resize(3);
    std::mt19937 rng(seed);
    std::vector<Vector3d> points;
    std::uniform_real_distribution<double> uniform(-0.8, 0.8);
    for (int k = 0; k < 200; ++k) points.emplace_back(uniform(rng), uniform(rng), uniform(rng));
    for (View& view : scene.train) {
        if (with_tracks) view.observations = shown(view.camera, points);
        const PoseLearner pose(view.camera, points);
        view.camera = pose.moved(view.camera, random_way(rng, off_by));
    }
    return scene;
}

TrainOptions small_options(const std::filesystem::path& folder, std::int64_t iterations) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.model = folder.string();
    o.iterations = iterations;
    o.device = Device::kCpu;
    o.cap_max = 1500, o.init_points = 1000;
    o.refine_cameras = RefineCameras::kOn;
    return resolve(o);
}

TrainSummary run(const TrainOptions& options, Scene& scene) {
    Progress progress(ProgressStyle::kSilent);
    return train(options, scene, open_run(options), progress, {});
}

std::vector<Camera> cameras_of(const Scene& scene) {
    std::vector<Camera> cameras;
    for (const View& view : scene.train) cameras.push_back(view.camera);
    return cameras;
}

/// Returns the mean way of cameras from the right ones, without what moves all, in pixels.
double mean_error(const Scene& scene) {
    const Scene truth = small_scene(0, false);
    const Similarity drift = similarity_of(cameras_of(truth), cameras_of(scene));
    double sum = 0;
    for (std::size_t k = 0; k < scene.train.size(); ++k) {
        Camera camera = scene.train[k].camera;
        const Vector3d center = drift.rotation.transpose() * (camera.center() - drift.shift) / drift.scale;
        camera.rotation = camera.rotation * drift.rotation;
        camera.translation = -(camera.rotation * center);
        std::vector<Vector3d> points;
        for (const Eigen::Vector3f& point : scene.points.positions) points.push_back(point.cast<double>());
        if (points.empty())
            for (int p = 0; p < 64; ++p)
                points.emplace_back(p % 4 * 0.4 - 0.6, p / 4 % 4 * 0.4 - 0.6, p / 16 * 0.4 - 0.6);
        sum += PoseLearner(truth.train[k].camera, points).way_to(camera).norm();
    }
    return sum / double(scene.train.size());
}

TEST(CameraRefinement, TracksBringPosesBackAtOnce) {
    const test::TemporaryFolder folder;
    Scene scene = small_scene(1, true);
    const double before = mean_error(scene);
    CameraRefinement cameras(small_options(folder.path() / "run", 300), scene);
    EXPECT_TRUE(cameras.is_active());
    EXPECT_GT(before, 1);
    EXPECT_LT(mean_error(scene), 0.01 * before);
    // Poses that fit their tracks as they are stay as they are.
    Scene right = small_scene(0, true);
    const Scene given = right;
    const CameraRefinement unmoved(small_options(folder.path() / "run", 300), right);
    for (std::size_t k = 0; k < right.train.size(); ++k)
        EXPECT_EQ(right.train[k].camera.translation, given.train[k].camera.translation);
}

TEST(CameraRefinement, PhotographsBringPosesBackAndTheWholeStays) {
    const test::TemporaryFolder folder;
    Scene scene = small_scene(0.7, false);
    const std::vector<Camera> given = cameras_of(scene);
    const double before = mean_error(scene);
    run(small_options(folder.path() / "run", 2000), scene);
    std::printf("mean error of the poses: %.3f pixels before, %.3f after\n", before, mean_error(scene));
    EXPECT_LT(mean_error(scene), 0.6 * before);
    const Similarity drift = similarity_of(given, cameras_of(scene));
    EXPECT_LT((drift.rotation - Eigen::Matrix3d::Identity()).norm(), 1e-6);
    EXPECT_NEAR(drift.scale, 1, 1e-6);
    EXPECT_LT(drift.shift.norm(), 1e-6);
    // cameras.json has both.
    const auto listed = read_cameras_json(RunFolder{folder.path() / "run"}.cameras());
    std::size_t refined = 0;
    for (const ListedView& view : listed) refined += view.refined.has_value();
    EXPECT_EQ(refined, scene.train.size() + scene.test.size()) << "test images have the learned lens";
}

/// Returns the room through a wide lens whose training images state another coefficient of distortion.
Scene lens_scene(double off_by) {
    SceneOptions options;
    options.resolution = 64, options.eval = true, options.lens = LensMode::kNative;
    Scene scene = load_builtin_scene("room-k1", options);
    scene.train.resize(24), scene.test.resize(3);
    for (View& view : scene.train) {
        view.camera.distortion[0] += off_by;
        view.camera.range = lens_range(view.camera);
    }
    return scene;
}

TEST(CameraRefinement, PhotographsBringTheDistortionBack) {
    const test::TemporaryFolder folder;
    Scene scene = lens_scene(0.08);
    const Camera given = scene.train[0].camera;
    TrainOptions options = small_options(folder.path() / "run", 1500);
    options.source = "builtin:room-k1";
    run(options, scene);
    const Camera& learned = scene.train[0].camera;
    std::printf("coefficient: %.4f given, %.4f learned, -0.18 right\n", given.distortion[0], learned.distortion[0]);
    EXPECT_LT(std::abs(learned.distortion[0] + 0.18), 0.5 * 0.08);
    EXPECT_NE(learned.range.max_angle, given.range.max_angle);
    EXPECT_EQ(scene.train[0].camera.distortion, scene.train[5].camera.distortion);
}

TEST(CameraRefinement, LearnsTheSameTwiceWithBatchesAndPhotometricCorrection) {
    const test::TemporaryFolder folder;
    TrainOptions options = small_options(folder.path() / "run", 200);
    options.ppisp = PpispMode::kOn;
    options.batch = 2;
    Scene once = small_scene(0.5, false), again = small_scene(0.5, false);
    run(options, once);
    options.model = (folder.path() / "again").string();
    run(options, again);
    const Scene given = small_scene(0.5, false);
    for (std::size_t k = 0; k < once.train.size(); ++k) {
        EXPECT_NE(once.train[k].camera.translation, given.train[k].camera.translation) << k;
        EXPECT_EQ(once.train[k].camera.translation, again.train[k].camera.translation) << k;
    }
}

/// Compares the cameras of a run that stopped at iteration 157 of 400 with those of one that did not.
void expect_same_after_resuming(const std::function<Scene()>& make_scene) {
    const test::TemporaryFolder folder;
    TrainOptions options = small_options(folder.path() / "whole", 400);
    options.checkpoint_iterations = {157};
    Scene whole = make_scene();
    run(options, whole);
    TrainOptions rest = options;
    rest.model = (folder.path() / "rest").string();
    rest.resume = RunFolder{folder.path() / "whole"}.checkpoint(157).string();
    Scene resumed = make_scene();
    run(rest, resumed);
    const Scene given = make_scene();
    for (std::size_t k = 0; k < whole.train.size(); ++k) {
        const Camera &a = resumed.train[k].camera, &b = whole.train[k].camera;
        EXPECT_EQ(a.rotation, b.rotation) << k;
        EXPECT_EQ(a.translation, b.translation) << k;
        EXPECT_EQ(static_cast<const LensCamera&>(a), b) << k;
        EXPECT_EQ(a.range.max_angle, b.range.max_angle) << k;
        EXPECT_NE(b.translation, given.train[k].camera.translation);
    }
}

TEST(CameraRefinement, AResumedRunEqualsOneThatNeverStopped) {
    expect_same_after_resuming([] { return small_scene(0.5, false); });
    expect_same_after_resuming([] { return lens_scene(0.08); });
}

}  // namespace
}  // namespace gs
