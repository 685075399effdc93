// SPDX-License-Identifier: Apache-2.0
// A small exact ray caster: analytic shapes, analytic shading, no textures and no random numbers.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "lib/io/image.h"
#include "lib/scene/scene.h"

namespace gs::procedural {

/// The surface of a shape. The checker alternates `albedo` and `albedo2` in cubes of side `checker` in object space.
struct Material {
    Eigen::Vector3d albedo{0.8, 0.8, 0.8};
    Eigen::Vector3d albedo2{0.8, 0.8, 0.8};
    double checker = 0;     ///< side of a checker cube, world units; 0 = uniform albedo
    double specular = 0;    ///< strength of the glossy lobe, 0 = diffuse
    double sharpness = 50;  ///< exponent of the glossy lobe around the mirror direction
};

enum class ShapeKind { kSphere, kBox, kPlane };

/// Sphere: |p - center| = radius. Box: |R^T (p - center)| <= half_size per axis. Plane: the points p with
/// dot(p - center, R e_z) = 0, unbounded.
struct Shape {
    std::string name;
    ShapeKind kind = ShapeKind::kSphere;
    Eigen::Vector3d center{0, 0, 0};
    double radius = 1;
    Eigen::Vector3d half_size{1, 1, 1};
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< world_from_object
    Material material;
    bool visible = true, blocks_light = true;
};

/// A directional light, or the parallelogram center + s*edge_u + t*edge_v, s,t in [-1,1], sampled on a fixed grid.
struct Light {
    bool directional = true;
    Eigen::Vector3d direction{0, 0, 1};  ///< unit, towards the light (directional)
    Eigen::Vector3d center{0, 0, 5}, edge_u{1, 0, 0}, edge_v{0, 1, 0};
    int samples = 3;                 ///< grid is samples x samples (area light)
    Eigen::Vector3d color{1, 1, 1};  ///< diffuse reflection of an unshadowed white surface that faces the light
};

/// The sky's colour in the unit direction d: lerp(horizon, zenith, d.z), and `ground` below the horizon.
struct Sky {
    Eigen::Vector3d zenith{0.4, 0.5, 0.7}, horizon{0.7, 0.7, 0.7}, ground{0.2, 0.2, 0.2};
};

/// Everything but the camera that determines a pixel. World axes: z up. Colours are display values: no tone curve is
/// applied.
struct World {
    std::vector<Shape> shapes;
    std::vector<Light> lights;
    Sky sky;
    double ambient = 0.3;                       ///< factor of the sky colour in the normal's direction
    std::optional<Eigen::Vector3d> background;  ///< colour of rays that hit nothing; empty = sky
};

struct Ray {
    Eigen::Vector3d origin, direction;  ///< `direction` has unit length
};

struct Hit {
    double t = 0;  ///< distance along the ray
    Eigen::Vector3d position, normal;
    const Shape* shape = nullptr;
};

/// The light from a point towards the eye. `diffuse` does not depend on the direction; `specular` does.
struct Radiance {
    Eigen::Vector3d diffuse{0, 0, 0}, specular{0, 0, 0};
};

/// Returns the ray through image position (x, y) in pixels, if the lens sees one there. The centre of the first pixel
/// is (0.5, 0.5).
std::optional<Ray> camera_ray(const Camera& camera, double x, double y);

/// Returns the ray's nearest hit with a visible surface in front of its origin, if any.
std::optional<Hit> intersect(const World& world, const Ray& ray);

/// Returns true if the ray from `point` along `direction` hits a shape within the distance `limit`. The ray starts
/// slightly off the surface, along `normal`.
bool occluded(const World& world, const Eigen::Vector3d& point, const Eigen::Vector3d& normal,
              const Eigen::Vector3d& direction, double limit);

/// Shades a hit seen along `direction` (unit, from the eye):
/// diffuse = albedo * (ambient * sky(n) + sum over lights of color * max(n.l, 0) * visible fraction);
/// specular = strength * (sum over lights of color * max(mirror.l, 0)^sharpness * visible fraction + ambient *
/// sky(mirror)).
Radiance shade(const World& world, const Hit& hit, const Eigen::Vector3d& direction);

/// Returns the sky's colour in a unit direction.
Eigen::Vector3d sky_color(const Sky& sky, const Eigen::Vector3d& direction);

/// Renders a float (H,W,3) image, not clamped. Each pixel is the mean of grid x grid rays; it is
/// black where the lens sees none. The result does not depend
/// on the number of threads.
Image render(const World& world, const Camera& camera, int grid);

}  // namespace gs::procedural
