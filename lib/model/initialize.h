// SPDX-License-Identifier: Apache-2.0
// Makes the Gaussians with which a training run begins: from points, or from a trained model.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "kernels/state/gaussian_state.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

struct InitOptions {
    /// Whether Gaussians begin with opacity 0.5 and a tenth of the neighbour distance as scale; otherwise they begin
    /// with 0.1 and the whole distance.
    bool mcmc = true;
    std::int64_t random_points = 100000;  ///< points drawn if the scene has none; fewer remain after carving
    std::uint64_t seed = 0;
    std::int64_t most_points = 0;  ///< an even sample of this many is kept; 0 = all
};

/// Returns the part of a run's options that concerns its beginning.
InitOptions init_options(const TrainOptions& options);

/// Returns the finite points of the scene. If it has none, draws grey points uniformly in a cube and keeps those that
/// at least one training view sees. Of more than most_points it keeps a sample. The cube is the scene's own
/// (random_init_half_extent) or reaches 3 extents from the mean camera position. The result depends on the seed, not on
/// the number of threads. Throws DataError when no point is left.
PointCloud initial_points(const Scene& scene, const InitOptions& options);

/// Makes one Gaussian per initial point, in their order, without moments: isotropic scale from the mean squared
/// distance to the 3 nearest other points, rotation (1,0,0,0), the base colour that shows the point's colour, and the
/// model's initial residual. Source: docs/math/optimization.md#first-gaussians.
Gaussians initialize_gaussians(const Scene& scene, const AppearanceSpec& appearance, const InitOptions& options);

/// Gives every Gaussian the initial residual of its model, which begins along the mean direction from the training
/// cameras where it has a direction. The means must be set.
void initialize_residuals(const Scene& scene, Gaussians& gaussians);

/// Returns the centres of the training cameras, or of an even sample if there are many.
std::vector<Eigen::Vector3d> sampled_cameras(const Scene& scene);

/// Returns the mean squared distance of each point to its 3 nearest others (fewer if there are fewer; 0 for a single
/// point). Exact; points at the same place have distance 0.
std::vector<double> mean_squared_neighbor_distances(const std::vector<Eigen::Vector3f>& points);

/// A model as its file has it.
struct InitialModel {
    std::filesystem::path file;
    Gaussians gaussians;
    std::optional<Frame> frame = {};  ///< the frame that they are in; empty: scene coordinates
};

/// Reads a .ply file (of gsapp, or of any program that writes 3DGS's), or the last point cloud in a run folder. Throws
/// DataError for a file that cannot be read or has no Gaussians, and UsageError for what is neither file nor folder.
InitialModel read_initial_model(const std::filesystem::path& from);

/// Returns the Gaussians in the frame of `scene` and with `appearance`, without moments. Where the file has the same
/// appearance model, its residuals stay; of plain spherical harmonics the bands that both have. Otherwise the base
/// takes the mean of the colours that sampled training cameras see, and residuals begin as those that show nothing.
Gaussians start_from(InitialModel model, const Scene& scene, const AppearanceSpec& appearance, std::uint64_t seed);

}  // namespace gs
