// SPDX-License-Identifier: Apache-2.0
// Chooses the order and direction in which an ellipsoid's axes are stored.
#include "lib/export/ellipsoid_axes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace gs {
namespace {

/// Axes thinner than this, relative to the longest, count as this thick, because a pixel blurs them. 0.3 measured the
/// same, 0.01 worse.
constexpr double kThinnest = 0.1;

struct Relabelling {
    Eigen::Quaterniond rotation;
    std::array<std::size_t, 3> axis;  ///< new axis k is the old axis[k], perhaps reversed
};

/// Returns the rotations of a cube; the first is the identity.
std::vector<Relabelling> cube_rotations() {
    std::vector<Relabelling> all;
    for (int x = 0; x < 3; ++x) {
        for (int y = 0; y < 3; ++y) {
            for (int signs = 0; signs < 4 && x != y; ++signs) {
                Eigen::Matrix3d axes;
                axes.col(0) = Eigen::Vector3d::Unit(x) * (signs & 1 ? -1 : 1);
                axes.col(1) = Eigen::Vector3d::Unit(y) * (signs & 2 ? -1 : 1);
                axes.col(2) = axes.col(0).cross(axes.col(1));
                all.push_back({Eigen::Quaterniond(axes), {std::size_t(x), std::size_t(y), std::size_t(3 - x - y)}});
            }
        }
    }
    return all;
}

/// Returns the squared change of the outline, relative to its axes, when an ellipsoid turns by a few degrees `turn`
/// (radians about its own axes).
double visible_change(const Eigen::Vector3d& turn, const std::array<double, 3>& scale) {
    const double longest = *std::max_element(scale.begin(), scale.end());
    const auto thickness = [&](std::size_t k) { return longest > 0 ? std::max(scale[k % 3] / longest, kThinnest) : 1; };
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) {
        const double ratio = thickness(k + 1) / thickness(k + 2), change = turn[Eigen::Index(k)] * (ratio - 1 / ratio);
        sum += change * change;
    }
    return sum;
}

}  // namespace

void choose_axes(PackedGeometry& geometry) {
    static const std::vector<Relabelling> relabellings = cube_rotations();
    const Eigen::Quaterniond rotation = Eigen::Quaterniond(geometry.rotation.data()).normalized();
    const std::array<double, 3> scale = geometry.scale;
    double least = std::numeric_limits<double>::infinity();
    for (const Relabelling& relabelling : relabellings) {
        const Eigen::Quaterniond q = rotation * relabelling.rotation;
        const std::array<double, 4> xyzw = {q.x(), q.y(), q.z(), q.w()};
        const std::array<double, 3> relabelled = {scale[relabelling.axis[0]], scale[relabelling.axis[1]],
                                                  scale[relabelling.axis[2]]};
        const Eigen::Quaterniond decoded(decode_rotation(rotation_codes(xyzw)).data());
        const double change = visible_change(2 * (q.conjugate() * decoded).vec(), relabelled);
        if (change < least) least = change, geometry.rotation = xyzw, geometry.scale = relabelled;
    }
}

}  // namespace gs
