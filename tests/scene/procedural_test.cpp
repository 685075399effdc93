// SPDX-License-Identifier: Apache-2.0
// The ray caster against closed forms, and the built-in scenes against what they promise.
#include "lib/scene/procedural.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/scene/procedural_description.h"

namespace gs {
namespace {

using namespace procedural;
using Eigen::Vector3d;

World world_with(const Shape& shape) {
    World world;
    world.shapes.push_back(shape);
    world.ambient = 0;
    world.background = Vector3d::Zero();
    return world;
}

Shape sphere(const Vector3d& center, double radius) {
    Shape shape;
    shape.center = center;
    shape.radius = radius;
    return shape;
}

std::string message_of(const std::function<void()>& work) {
    try {
        work();
    } catch (const Error& e) {
        return e.what();
    }
    return "";
}

Description small(const std::string& name) {
    Description d = load_description(name);
    d.cameras.width = 40;
    d.cameras.height = 30;
    return d;
}

int different_pixels(const Image& a, const Image& b) {
    int count = 0;
    for (std::size_t i = 0; i < a.f32.size(); i += 3) {
        count += a.f32[i] != b.f32[i] || a.f32[i + 1] != b.f32[i + 1] || a.f32[i + 2] != b.f32[i + 2];
    }
    return count;
}

TEST(RayCaster, SphereHitIsTheSmallerRootOfTheQuadratic) {
    const Vector3d center(0.3, -0.2, 5), direction = Vector3d(0.05, -0.02, 1).normalized();
    const double radius = 1.5, b = center.dot(direction),
                 root = std::sqrt(b * b - center.squaredNorm() + radius * radius);
    const World world = world_with(sphere(center, radius));
    const auto hit = intersect(world, {Vector3d::Zero(), direction});
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->t, b - root, 1e-12);
    EXPECT_NEAR((hit->normal - (direction * (b - root) - center) / radius).norm(), 0, 1e-12);
    EXPECT_FALSE(intersect(world, {Vector3d::Zero(), Vector3d(0, 1, 0)}));
    EXPECT_FALSE(intersect(world, {Vector3d(0, 0, 10), Vector3d(0, 0, 1)})) << "behind the origin";
    const auto from_inside = intersect(world, {center, Vector3d(1, 0, 0)});
    ASSERT_TRUE(from_inside);
    EXPECT_NEAR(from_inside->t, radius, 1e-12);
    EXPECT_NEAR(from_inside->normal.x(), -1, 1e-12) << "normals face the viewer";
}

TEST(RayCaster, PlaneHitFollowsFromTheHeight) {
    Shape plane;
    plane.kind = ShapeKind::kPlane;
    plane.center = {7, 8, 1};
    const World world = world_with(plane);
    const Vector3d direction = Vector3d(0.3, 0.1, -0.5).normalized();
    const auto hit = intersect(world, {Vector3d(0, 0, 3), direction});
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->t, 2 / -direction.z(), 1e-12);
    EXPECT_NEAR(hit->position.z(), 1, 1e-12);
    EXPECT_FALSE(intersect(world, {Vector3d(0, 0, 3), Vector3d(1, 0, 0)})) << "parallel";
    EXPECT_FALSE(intersect(world, {Vector3d(0, 0, 3), Vector3d(0, 0, 1)})) << "away";
}

TEST(RayCaster, RotatedBoxIsHitOnItsCornerEdge) {
    Shape box;
    box.kind = ShapeKind::kBox;
    box.center = {0, 0, 0};
    box.half_size = {1, 1, 1};
    box.rotation = Eigen::AngleAxisd(M_PI / 4, Vector3d::UnitZ()).toRotationMatrix();
    const World world = world_with(box);
    // Turned by 45 degrees the box reaches sqrt(2) along x; its faces there are at slope 1.
    const auto hit = intersect(world, {Vector3d(-5, 0.25, 0), Vector3d(1, 0, 0)});
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->position.x(), -(std::sqrt(2.0) - 0.25), 1e-12);
    EXPECT_NEAR(hit->normal.dot(Vector3d(-1, 1, 0).normalized()), 1, 1e-12);
    EXPECT_FALSE(intersect(world, {Vector3d(-5, 1.45, 0), Vector3d(1, 0, 0)}));
}

TEST(RayCaster, SphereCentreLandsWhereTheCameraProjectsIt) {
    CameraRig rig;
    rig.look_at = {0.2, -0.1, 0.3};
    for (int index = 0; index < rig.train; index += 7) {
        const Camera camera = rig_camera(rig, false, index);
        EXPECT_NEAR((camera.rotation * camera.rotation.transpose() - Eigen::Matrix3d::Identity()).norm(), 0, 1e-12);
        EXPECT_NEAR(camera.rotation.determinant(), 1, 1e-12);
        EXPECT_NEAR((camera.center() - rig.look_at).norm(), rig.radius, 1e-12);
        EXPECT_GT((camera.rotation * Vector3d(0, 0, -1)).y(), 0) << "world down points down in the picture";
        const Vector3d center(0.4, 0.3, 0.5), local = camera.rotation * center + camera.translation;
        const double u = camera.fx * local.x() / local.z() + camera.cx,
                     v = camera.fy * local.y() / local.z() + camera.cy;
        const auto hit = intersect(world_with(sphere(center, 1e-4)), *camera_ray(camera, u, v));
        ASSERT_TRUE(hit) << "the ray of the projection misses a tiny sphere";
        EXPECT_NEAR(hit->t, local.norm() - 1e-4, 1e-9);
    }
}

TEST(RayCaster, CentroidOfARenderedSphereIsItsProjection) {
    Camera camera;
    camera.width = 64;
    camera.height = 48;
    camera.fx = camera.fy = 60;
    camera.cx = 31.3;
    camera.cy = 23.9;
    World world = world_with(sphere({0.4, -0.2, 5}, 0.3));
    world.ambient = 1;
    world.sky = {Vector3d::Ones(), Vector3d::Ones(), Vector3d::Ones()};
    const Image image = render(world, camera, 4);
    double sum = 0, x_sum = 0, y_sum = 0;
    for (int y = 0; y < image.height; ++y) {
        for (int x = 0; x < image.width; ++x) {
            const double w = image.value(x, y, 0);
            sum += w, x_sum += w * (x + 0.5), y_sum += w * (y + 0.5);
        }
    }
    EXPECT_NEAR(x_sum / sum, 60 * 0.4 / 5 + 31.3, 0.05);
    EXPECT_NEAR(y_sum / sum, 60 * -0.2 / 5 + 23.9, 0.05);
    EXPECT_NEAR(sum / 0.8, M_PI * std::pow(60 * 0.3 / 5, 2), 0.03 * M_PI * 3.6 * 3.6) << "area of the disc, albedo 0.8";
}

TEST(RayCaster, ShadingFollowsItsFormula) {
    Shape plane;
    plane.kind = ShapeKind::kPlane;
    plane.material.albedo = {0.5, 0.25, 1};
    plane.material.specular = 0.5;
    plane.material.sharpness = 10;
    World world = world_with(plane);
    Light light;
    light.direction = Vector3d(0, 0.6, 0.8);
    light.color = {1, 1, 0.5};
    world.lights.push_back(light);
    const Vector3d eye = Vector3d(0, 0.5, -1).normalized();
    const auto hit = intersect(world, {Vector3d(0, 0, 2), eye});
    ASSERT_TRUE(hit);
    const Radiance seen = shade(world, *hit, eye);
    EXPECT_NEAR((seen.diffuse - 0.8 * Vector3d(0.5, 0.25, 0.5)).norm(), 0, 1e-12);
    const double lobe = std::pow((0.6 * 0.5 + 0.8) / std::sqrt(1.25), 10);
    EXPECT_NEAR((seen.specular - 0.5 * lobe * light.color).norm(), 0, 1e-12);

    world.shapes.push_back(sphere(hit->position + 2 * light.direction, 0.5));
    const auto again = intersect(world, {Vector3d(0, 0, 2), eye});  // a hit points into the shapes, which have moved
    ASSERT_TRUE(again);
    const Radiance shadowed = shade(world, *again, eye);
    EXPECT_EQ(shadowed.diffuse.norm() + shadowed.specular.norm(), 0);
}

TEST(RayCaster, AreaLightGivesThePartThatIsNotBlocked) {
    Shape plane;
    plane.kind = ShapeKind::kPlane;
    World world = world_with(plane);
    Light light;
    light.directional = false;
    light.center = {0, 0, 1000};  // far away: every sample falls vertically, cosine 1
    light.edge_u = {1, 0, 0};
    light.edge_v = {0, 1, 0};
    light.samples = 4;
    world.lights.push_back(light);
    Shape half;  // covers the light's x > 0 half just below it
    half.kind = ShapeKind::kBox;
    half.center = {5, 0, 999};
    half.half_size = {5, 5, 0.1};
    world.shapes.push_back(half);
    const auto hit = intersect(world, {Vector3d(0, 0, 2), Vector3d(0, 0, -1)});
    ASSERT_TRUE(hit);
    EXPECT_NEAR(shade(world, *hit, Vector3d(0, 0, -1)).diffuse.x(), 0.5 * 0.8, 1e-5);
}

TEST(RayCaster, CheckerAlternates) {
    Shape plane;
    plane.kind = ShapeKind::kPlane;
    plane.material.albedo = {1, 1, 1};
    plane.material.albedo2 = {0, 0, 0};
    plane.material.checker = 0.5;
    World world = world_with(plane);
    world.ambient = 1;
    world.sky = {Vector3d::Ones(), Vector3d::Ones(), Vector3d::Ones()};
    const auto seen = [&](double x, double y) {
        const Vector3d down(0, 0, -1);
        return shade(world, *intersect(world, {Vector3d(x, y, 1), down}), down).diffuse.x();
    };
    EXPECT_NE(seen(0.1, 0.1), seen(0.6, 0.1));
    EXPECT_NE(seen(0.1, 0.1), seen(0.1, 0.6));
    EXPECT_EQ(seen(0.1, 0.1), seen(0.6, 0.6));
    EXPECT_EQ(seen(0.1, 0.1), seen(0.45, 0.4));
    EXPECT_NE(seen(0.1, 0.1), seen(-0.1, 0.1)) << "cells do not double at the origin";
}

TEST(RayCaster, SameImageForAnyNumberOfThreads) {
    const Description d = small("glossy");
    set_num_threads(1);
    const Image one = render(d.world, rig_camera(d.cameras, false, 3), 2);
    set_num_threads(3);
    const Image three = render(d.world, rig_camera(d.cameras, false, 3), 2);
    set_num_threads(0);
    EXPECT_EQ(one.f32, three.f32);
}

TEST(BuiltinScenes, AllLoadAtAChosenWidth) {
    ASSERT_GE(builtin_scene_names().size(), 5u);
    for (const std::string& name : builtin_scene_names()) {
        SceneOptions options;
        options.eval = true;
        options.resolution = 32;
        const Scene scene = load_builtin_scene(name, options);
        const Description d = load_description(name);
        ASSERT_EQ(int(scene.train.size()), d.cameras.train) << name;
        ASSERT_EQ(int(scene.test.size()), d.cameras.test) << name;
        EXPECT_EQ(int(scene.points.positions.size()), d.points) << name;
        EXPECT_GT(scene.extent, 1) << name;
        const Camera& camera = scene.train[0].camera;
        if (is_pinhole(rig_lens(d.cameras)) || !is_pinhole(camera)) {  // an undistorted image has a size of its own
            EXPECT_EQ(camera.width, 32) << name;
            EXPECT_EQ(camera.height, std::lround(32.0 * d.cameras.height / d.cameras.width)) << name;
        }
        const Image image = scene.test[0].load().color;
        EXPECT_EQ(image.width, camera.width) << name;
        EXPECT_EQ(image.height, camera.height) << name;
        EXPECT_EQ(image.bytes(), scene.test[0].image_bytes);
        double mean = 0;
        for (const auto v : image.u8) mean += v / 255.0 / double(image.u8.size());
        EXPECT_GT(mean, 0.1) << name << " is nearly black";
        EXPECT_LT(mean, 0.9) << name << " is nearly white";
    }
}

TEST(BuiltinScenes, ResolutionDividesAndEvalHoldsOut) {
    SceneOptions options;
    options.resolution = 8;
    const Scene scene = load_builtin_scene("diffuse", options);
    EXPECT_EQ(scene.train[0].camera.width, 20);
    EXPECT_TRUE(scene.test.empty());
    options.resolution = 3;
    EXPECT_THROW(load_builtin_scene("diffuse", options), UsageError);
}

TEST(BuiltinScenes, PointsLieOnSurfaces) {
    SceneOptions options;
    options.resolution = 16;
    const Scene scene = load_builtin_scene("diffuse", options);
    const Description d = load_description("diffuse");
    const auto eye = scene.train[0].camera.center();
    int on_table = 0;
    for (std::size_t i = 0; i < scene.points.positions.size(); i += 17) {
        const Vector3d p = scene.points.positions[i].cast<double>();
        on_table += std::abs(p.z()) < 1e-5;
        // From just outside, a ray to the point ends at it or at something in front, never beyond.
        const Vector3d direction = (p - eye).normalized();
        const auto hit = intersect(d.world, {eye, direction});
        ASSERT_TRUE(hit);
        EXPECT_LE(hit->t, (p - eye).norm() + 1e-4);
        EXPECT_GE(scene.points.colors[i].minCoeff(), 0);
        EXPECT_LE(scene.points.colors[i].maxCoeff(), 1);
    }
    EXPECT_GT(on_table, 30);
}

TEST(BuiltinScenes, DiffuseDoesNotDependOnTheDirectionAndGlossyDoes) {
    double largest = 0;
    for (const char* name : {"diffuse", "glossy"}) {
        const Description d = small(name);
        largest = 0;
        for (int i = 0; i < 200; ++i) {
            const auto ray = *camera_ray(rig_camera(d.cameras, false, 1), 0.2 * i, 15);
            if (const auto hit = intersect(d.world, ray))
                largest = std::max(largest, shade(d.world, *hit, ray.direction).specular.maxCoeff());
        }
        if (std::string(name) == "diffuse") {
            EXPECT_EQ(largest, 0);
        }
    }
    EXPECT_GT(largest, 0.1);
}

TEST(BuiltinScenes, MovedObjectDiffersOnlyInTheChosenViews) {
    const Description d = small("moved");
    for (int index = 0; index < 8; ++index) {
        const Camera camera = rig_camera(d.cameras, false, index);
        const int different = different_pixels(render(train_world(d, index), camera, 1), render(d.world, camera, 1));
        if (index % d.moved->every == d.moved->every - 1) {
            EXPECT_GT(different, 20) << index;
            EXPECT_LT(different, 40 * 30 / 2) << index << ": most of the picture must stay";
        } else {
            EXPECT_EQ(different, 0) << index;
        }
    }
}

TEST(BuiltinScenes, DistractorsCoverTheirShareOfEveryView) {
    for (const char* name : {"distractors", "distractors-30"}) {
        const Description d = small(name);
        const double share = d.distractors->share;
        double mean = 0;
        for (int index = 0; index < d.cameras.train; ++index) {
            const Camera camera = rig_camera(d.cameras, false, index);
            const World world = train_world(d, index);
            ASSERT_GT(world.shapes.size(), d.world.shapes.size() + 1) << index;
            int covered = 0;
            for (int i = 0; i < camera.width * camera.height; ++i) {
                const auto hit = intersect(world, *camera_ray(camera, i % camera.width + 0.5, i / camera.width + 0.5));
                covered += hit && hit->shape->name == "distractor";
            }
            const double part = double(covered) / (camera.width * camera.height);
            EXPECT_GT(part, 0.85 * share) << index;
            EXPECT_LT(part, 2 * share) << index;
            mean += part / d.cameras.train;
        }
        EXPECT_NEAR(mean, 1.2 * share, 0.2 * share);
        const Camera first = rig_camera(d.cameras, false, 0);
        World unlit = train_world(d, 0);
        for (Shape& shape : unlit.shapes) shape.visible = shape.name != "distractor";
        EXPECT_EQ(different_pixels(render(unlit, first, 1), render(d.world, first, 1)), 0) << "no shadows";
        EXPECT_NE(train_world(d, 0).shapes.back().center, train_world(d, 1).shapes.back().center);
        EXPECT_EQ(train_world(d, 0).shapes.back().center, train_world(d, 0).shapes.back().center);
    }
}

TEST(BuiltinScenes, ShadowOnlyDarkensAndIsNeverSeen) {
    const Description d = small("shadow");
    int darkened = 0;
    for (int index = 0; index < d.cameras.train; ++index) {
        const Camera camera = rig_camera(d.cameras, false, index);
        const Image with = render(train_world(d, index), camera, 1), without = render(d.world, camera, 1);
        const int different = different_pixels(with, without);
        if (index % d.shadow->every != d.shadow->every - 1) {
            EXPECT_EQ(different, 0) << index;
        }
        for (std::size_t i = 0; i < with.f32.size(); ++i) ASSERT_LE(with.f32[i], without.f32[i]);
        darkened += different > 20;
    }
    EXPECT_GT(darkened, 10);
}

TEST(BuiltinScenes, ExposureIsTheBaseSceneTimesKnownFactors) {
    SceneOptions options;
    options.eval = true;
    options.resolution = 16;
    const Scene jittered = load_builtin_scene("exposure", options), clean = load_builtin_scene("polished", options);
    Description d = load_description("exposure");
    d.cameras.width = 16, d.cameras.height = 12;
    std::vector<double> stops;
    for (const bool test : {false, true}) {
        const auto &views = test ? jittered.test : jittered.train, &base = test ? clean.test : clean.train;
        ASSERT_EQ(views.size(), base.size());
        for (std::size_t i = 0; i < base.size(); ++i) {
            const Photography settings = photography(d, test, int(i));
            EXPECT_EQ(views[i].exif_exposure, settings.stops);
            EXPECT_FALSE(base[i].exif_exposure);
            EXPECT_NEAR(settings.gain.prod(), 1, 1e-12);
            stops.push_back(settings.stops);
            const Image a = views[i].load().color, b = base[i].load().color;
            for (std::size_t k = 0; k < a.u8.size(); ++k) {
                const double factor = exposure_factor(d, settings, int(k / 3) % 16, int(k / 3) / 16)[int(k % 3)];
                if (b.u8[k] < 255) {
                    ASSERT_NEAR(a.u8[k], std::min(255.0, b.u8[k] * factor), 0.5 * factor + 0.5 + 1e-6) << "view " << i;
                }
            }
        }
    }
    EXPECT_GE(*std::min_element(stops.begin(), stops.end()), -1);
    EXPECT_LE(*std::max_element(stops.begin(), stops.end()), 1);
    EXPECT_GT(*std::max_element(stops.begin(), stops.end()) - *std::min_element(stops.begin(), stops.end()), 1.5);
    EXPECT_NE(photography(d, true, 0).stops, photography(d, false, 0).stops);
    EXPECT_NEAR(exposure_factor(d, {}, 0, 0).x() / exposure_factor(d, {}, 8, 6).x(), 0.85, 0.05)
        << "corner against centre";
    EXPECT_EQ(photography(load_description("glossy"), false, 3).stops, 0);
}

TEST(BuiltinScenes, TurnedCamerasLookAroundFromTheSamePlaces) {
    Description straight = small("room"), turned = straight;
    turned.cameras.turn = 60;
    double most = 0, sum = 0;
    constexpr int kViews = 400;
    straight.cameras.train = turned.cameras.train = kViews;
    for (int i = 0; i < kViews; ++i) {
        const Camera a = rig_camera(straight.cameras, false, i), b = rig_camera(turned.cameras, false, i);
        EXPECT_LT((a.rotation.transpose() * a.translation - b.rotation.transpose() * b.translation).norm(), 1e-12);
        EXPECT_NEAR(b.rotation.determinant(), 1, 1e-12);
        EXPECT_NEAR(b.rotation(0, 2), 0, 1e-12) << "world z is up in the picture";
        const double cosine = a.rotation.row(2).dot(b.rotation.row(2));
        sum += cosine, most = std::max(most, std::acos(cosine));
    }
    EXPECT_LE(most, M_PI / 3 + 1e-9);
    EXPECT_GT(most, 0.9 * M_PI / 3);
    EXPECT_NEAR(sum / kViews, 0.75, 0.03) << "all directions are as likely";
}

TEST(BuiltinScenes, MistakesAreNamed) {
    EXPECT_NE(message_of([] { load_description("glosy"); }).find("exposure, glossy"), std::string::npos);
    EXPECT_THROW(load_description("missing/file.yaml"), DataError);
    const auto message = [](const std::string& yaml) { return message_of([&] { parse_description(yaml, "x.yaml"); }); };
    EXPECT_EQ(message("base: diffuse"), "");
    EXPECT_NE(message("base: diffuse\nambiemt: 1").find("did you mean 'ambient'"), std::string::npos);
    EXPECT_NE(message("shapes: [{kind: sphere, material: {sharpnes: 3}}]")
                  .find("x.yaml.shapes[0].material: unknown key 'sharpnes'"),
              std::string::npos);
    EXPECT_NE(message("shapes: [{radius: -1}]").find("x.yaml.shapes[0].radius"), std::string::npos);
    EXPECT_NE(message("shapes: [{radius: .nan}]").find("outside"), std::string::npos);
    EXPECT_NE(message("shapes: [{center: [1, 2]}]").find("three numbers"), std::string::npos);
    EXPECT_NE(message("shapes: [{kind: cone}]").find("sphere, box, plane"), std::string::npos);
    EXPECT_NE(message("shapes: 3").find("list"), std::string::npos);
    EXPECT_NE(message("ambient: 1").find("at least one shape"), std::string::npos);
    EXPECT_NE(message("[1, 2]").find("mapping"), std::string::npos);
    EXPECT_NE(message("shapes: [").find("line 1"), std::string::npos);
    EXPECT_NE(message("base: [diffuse]").find("expected text"), std::string::npos);
    EXPECT_NE(message("base: nothing").find("no such scene"), std::string::npos);
    EXPECT_NE(message("base: diffuse\nviolations: {moved: {shape: ghost}}").find("no shape is named 'ghost'"),
              std::string::npos);
    EXPECT_NE(message("base: diffuse\nlights: [{direction: [0, 0, 0]}]").find("no direction"), std::string::npos);
}

}  // namespace
}  // namespace gs
