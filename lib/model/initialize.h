// SPDX-License-Identifier: Apache-2.0
// Makes the initial Gaussians of a training run from points or from a trained model.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "kernels/state/gaussian_state.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

struct InitOptions {
    /// Whether the initial opacity is 0.5 and the scale a tenth of the neighbour distance; otherwise opacity 0.1 and
    /// the full distance.
    bool mcmc = true;
    std::int64_t random_points = 100000;  ///< number of points drawn if the scene has none; unseen ones are removed
    std::uint64_t seed = 0;
    std::int64_t most_points = 0;  ///< number of points to keep, evenly spaced in the list; 0 = all
};

/// Returns the initialisation options that follow from a run's options.
InitOptions init_options(const TrainOptions& options);

/// Returns the finite points of the scene. If it has none, draws grey points uniformly in a cube and keeps those that
/// at least one training view sees. If there are more than most_points, keeps an evenly spaced sample. The cube is the
/// scene's own (random_init_half_extent) or extends 3 scene extents from the mean camera position. The result depends
/// on the seed, not on the number of threads. Throws DataError if no point is left.
PointCloud initial_points(const Scene& scene, const InitOptions& options);

/// Makes one Gaussian per initial point, in their order, without moments: isotropic scale from the mean squared
/// distance to the 3 nearest other points, rotation (1,0,0,0), the base colour that renders as the point's colour, and
/// the model's initial residual. Source: docs/math/optimization.md#first-gaussians.
Gaussians initialize_gaussians(const Scene& scene, const AppearanceSpec& appearance, const InitOptions& options);

/// Sets the initial residual of every Gaussian. A residual with a direction begins along the mean direction from the
/// training cameras to the Gaussian. The means must be set.
void initialize_residuals(const Scene& scene, Gaussians& gaussians);

/// Returns the centres of the training cameras, or of an evenly spaced sample of 32 if there are more.
std::vector<Eigen::Vector3d> sampled_cameras(const Scene& scene);

/// Returns the mean squared distance of each point to its 3 nearest other points (fewer if there are fewer; 0 for a
/// single point). The search is exact; points at the same position have distance 0.
std::vector<double> mean_squared_neighbor_distances(const std::vector<Eigen::Vector3f>& points);

/// A model as stored in its file.
struct InitialModel {
    std::filesystem::path file;
    Gaussians gaussians;
    std::optional<Frame> frame = {};  ///< frame of the Gaussians; empty: scene coordinates
};

/// Reads a .ply file (of gsapp, or of any program that writes 3DGS's), or the last point cloud in a run folder. Throws
/// DataError for a file that cannot be read or has no Gaussians, and UsageError if `from` is neither a file nor a
/// folder.
InitialModel read_initial_model(const std::filesystem::path& from);

/// Returns the Gaussians in the frame of `scene` and with `appearance`, without moments. If the file has the same
/// appearance, its residuals are kept; if both are plain spherical harmonics with the same activation, the bands common
/// to both are kept. Otherwise the base becomes the mean of the colours seen by sampled training cameras, and residuals
/// begin without effect.
Gaussians start_from(InitialModel model, const Scene& scene, const AppearanceSpec& appearance, std::uint64_t seed);

}  // namespace gs
