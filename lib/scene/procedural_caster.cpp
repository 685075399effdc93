// SPDX-License-Identifier: Apache-2.0
// Implements intersections, shadows, shading and the pixel loop of the procedural scenes.
#include "lib/scene/procedural_caster.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "kernels/base/parallel.h"

namespace gs::procedural {
namespace {

using Eigen::Vector3d;

/// The offset of secondary rays, world units. It is far above double rounding and far below anything visible.
constexpr double kSurfaceOffset = 1e-6;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Returns the smallest positive t of a hit, or infinity. The normal is computed later, only for the nearest hit.
double hit_distance(const Shape& shape, const Ray& ray) {
    if (shape.kind == ShapeKind::kSphere) {
        const Vector3d to_center = shape.center - ray.origin;
        const double along = to_center.dot(ray.direction);
        const double half_chord2 = shape.radius * shape.radius - (to_center - along * ray.direction).squaredNorm();
        if (half_chord2 < 0) return kInfinity;
        const double half_chord = std::sqrt(half_chord2);
        if (along - half_chord > 0) return along - half_chord;
        return along + half_chord > 0 ? along + half_chord : kInfinity;
    }
    // most rays miss the bounding sphere; this test is cheaper than rotating the ray
    if (shape.kind == ShapeKind::kBox) {
        const Vector3d to_center = shape.center - ray.origin;
        const double along = to_center.dot(ray.direction);
        if (to_center.squaredNorm() - along * along > shape.half_size.squaredNorm() * (1 + 1e-9)) return kInfinity;
    }
    const Vector3d origin = shape.rotation.transpose() * (ray.origin - shape.center);
    const Vector3d direction = shape.rotation.transpose() * ray.direction;
    if (shape.kind == ShapeKind::kPlane) {
        const double t = -origin.z() / direction.z();
        return t > 0 && t < kInfinity ? t : kInfinity;
    }
    double enter = -kInfinity, leave = kInfinity;
    for (int k = 0; k < 3; ++k) {
        if (direction[k] == 0) {
            if (std::abs(origin[k]) > shape.half_size[k]) return kInfinity;
            continue;
        }
        const double a = (-shape.half_size[k] - origin[k]) / direction[k];
        const double b = (shape.half_size[k] - origin[k]) / direction[k];
        enter = std::max(enter, std::min(a, b));
        leave = std::min(leave, std::max(a, b));
    }
    if (enter > leave || leave <= 0) return kInfinity;
    return enter > 0 ? enter : leave;
}

Vector3d surface_normal(const Shape& shape, const Vector3d& position) {
    if (shape.kind == ShapeKind::kSphere) return (position - shape.center) / shape.radius;
    if (shape.kind == ShapeKind::kPlane) return shape.rotation.col(2);
    const Vector3d local = shape.rotation.transpose() * (position - shape.center);
    int axis = 0;
    local.cwiseQuotient(shape.half_size).cwiseAbs().maxCoeff(&axis);
    return local[axis] < 0 ? Vector3d(-shape.rotation.col(axis)) : Vector3d(shape.rotation.col(axis));
}

Vector3d albedo_at(const Hit& hit) {
    const Material& material = hit.shape->material;
    if (material.checker <= 0) return material.albedo;
    // A point just inside the surface; otherwise a face that coincides with a border of the checker would flicker.
    const Vector3d inside = hit.position - kSurfaceOffset * hit.normal;
    const Vector3d cell = (hit.shape->rotation.transpose() * (inside - hit.shape->center)) / material.checker;
    const auto parity =
        std::int64_t(std::floor(cell.x())) + std::int64_t(std::floor(cell.y())) + std::int64_t(std::floor(cell.z()));
    return (parity & 1) == 0 ? material.albedo : material.albedo2;
}

/// Adds the contribution of one light sample; `weight` is its fraction of the light.
void add_light(const World& world, const Hit& hit, const Vector3d& mirror, const Light& light, const Vector3d& to_light,
               double distance, double weight, Radiance& out) {
    const double cosine = hit.normal.dot(to_light);
    if (cosine <= 0 || occluded(world, hit.position, hit.normal, to_light, distance)) return;
    const Material& material = hit.shape->material;
    out.diffuse += weight * cosine * light.color;
    const double lobe = mirror.dot(to_light);
    if (material.specular > 0 && lobe > 0) out.specular += weight * std::pow(lobe, material.sharpness) * light.color;
}

}  // namespace

std::optional<Ray> camera_ray(const Camera& camera, double x, double y) {
    const auto ray_to = [&](const Vector3d& local) {
        return Ray{camera.center(), (camera.rotation.transpose() * local).normalized()};
    };
    if (is_pinhole(camera)) return ray_to({(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1});
    const std::optional<Vector3d> local = unproject(camera, {x, y});
    if (!local || local->z() < std::cos(camera.range.max_angle)) return std::nullopt;
    return ray_to(*local);
}

std::optional<Hit> intersect(const World& world, const Ray& ray) {
    Hit hit;
    hit.t = kInfinity;
    for (const Shape& shape : world.shapes) {
        if (!shape.visible) continue;
        const double t = hit_distance(shape, ray);
        if (t < hit.t) {
            hit.t = t;
            hit.shape = &shape;
        }
    }
    if (!hit.shape) return std::nullopt;
    hit.position = ray.origin + hit.t * ray.direction;
    hit.normal = surface_normal(*hit.shape, hit.position);
    if (hit.normal.dot(ray.direction) > 0) hit.normal = -hit.normal;  // seen from behind or from inside
    return hit;
}

bool occluded(const World& world, const Vector3d& point, const Vector3d& normal, const Vector3d& direction,
              double limit) {
    const Ray ray{point + kSurfaceOffset * normal, direction};
    return std::any_of(world.shapes.begin(), world.shapes.end(),
                       [&](const Shape& shape) { return shape.blocks_light && hit_distance(shape, ray) < limit; });
}

Vector3d sky_color(const Sky& sky, const Vector3d& direction) {
    if (direction.z() < 0) return sky.ground;
    return sky.horizon + direction.z() * (sky.zenith - sky.horizon);
}

Radiance shade(const World& world, const Hit& hit, const Vector3d& direction) {
    const Vector3d mirror = direction - 2 * hit.normal.dot(direction) * hit.normal;
    Radiance sum;
    for (const Light& light : world.lights) {
        if (light.directional) {
            add_light(world, hit, mirror, light, light.direction, kInfinity, 1, sum);
            continue;
        }
        const double weight = 1.0 / (light.samples * light.samples);
        for (int i = 0; i < light.samples * light.samples; ++i) {
            const double s = (2 * (i % light.samples) + 1.0) / light.samples - 1,
                         t = (2 * (i / light.samples) + 1.0) / light.samples - 1;
            const Vector3d offset = light.center + s * light.edge_u + t * light.edge_v - hit.position;
            const double distance = offset.norm();
            add_light(world, hit, mirror, light, offset / distance, distance, weight, sum);
        }
    }
    const Material& material = hit.shape->material;
    sum.diffuse = albedo_at(hit).cwiseProduct(sum.diffuse + world.ambient * sky_color(world.sky, hit.normal));
    sum.specular = material.specular * (sum.specular + world.ambient * sky_color(world.sky, mirror));
    return sum;
}

Image render(const World& world, const Camera& camera, int grid) {
    Image image{camera.width, camera.height, 3, {}, {}};
    image.f32.resize(std::size_t(camera.width) * camera.height * 3);
    parallel_for(camera.height, [&](std::int64_t y) {
        for (int x = 0; x < camera.width; ++x) {
            Vector3d sum = Vector3d::Zero();
            for (int i = 0; i < grid * grid; ++i) {
                const auto ray = camera_ray(camera, x + (i % grid + 0.5) / grid, double(y) + (i / grid + 0.5) / grid);
                if (!ray) continue;
                if (const auto hit = intersect(world, *ray)) {
                    const Radiance light = shade(world, *hit, ray->direction);
                    sum += light.diffuse + light.specular;
                } else {
                    sum += world.background ? *world.background : sky_color(world.sky, ray->direction);
                }
            }
            for (int c = 0; c < 3; ++c)
                image.f32[(std::size_t(y) * camera.width + x) * 3 + c] = float(sum[c] / (grid * grid));
        }
    });
    return image;
}

}  // namespace gs::procedural
