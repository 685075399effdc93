// SPDX-License-Identifier: Apache-2.0
// The Gaussians a training run begins with.
#pragma once

#include <cstdint>

#include "kernels/model/gaussian_state.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

struct InitOptions {
    bool mcmc = true;                     ///< opacity 0.5 and a tenth of the neighbour distance; else 0.1 and the whole
    std::int64_t random_points = 100000;  ///< points drawn where the scene has none; fewer remain after carving
    std::uint64_t seed = 0;
};

/// What the options of a run say about its beginning.
InitOptions init_options(const TrainOptions& options);

/// The points of the scene that are finite; where it has none, grey points drawn uniformly in a cube and kept where at
/// least one training view sees them. The cube is the scene's own (random_init_half_extent, about the origin) or reaches
/// 3 extents from the mean camera position. Deterministic in the seed; independent of the number of threads.
/// Throws DataError when no point is left.
PointCloud initial_points(const Scene& scene, const InitOptions& options);

/// One Gaussian per initial point, in their order: isotropic scale from the mean squared distance to the 3 nearest
/// other points, rotation (1,0,0,0), base colour showing the point's colour, residual as the model begins. Without
/// moments. Source: docs/math/optimization.md#first-gaussians.
Gaussians initialize_gaussians(const Scene& scene, const AppearanceSpec& appearance, const InitOptions& options);

/// Mean squared distance of each point to its 3 nearest others (fewer where there are fewer; 0 for a single point).
/// Exact; points at the same place have distance 0.
std::vector<double> mean_squared_neighbor_distances(const std::vector<Eigen::Vector3f>& points);

}  // namespace gs
