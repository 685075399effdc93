// SPDX-License-Identifier: Apache-2.0
// Converts sixteen Gaussians at a time to splats, and finds the tiles that a splat touches, on the CPU.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/splat/gaussian_rows_device.h"

namespace gs {

/// The view of a camera in the form for sixteen Gaussians at once.
template <class Real> struct ViewLanes {
    CameraParams<Lanes<Real>> camera;
    Lanes<Real> width_padded, height_padded;  ///< size of the grid of whole tiles
    Lanes<Real> min_opacity, inverse_alpha;
    CameraParams<Real> one;  ///< the camera for one Gaussian at a time, as lenses are computed
    Cutoffs<Real> cutoffs;

    static ViewLanes of(const CameraParams<Real>& camera, int width_padded, int height_padded,
                        const Cutoffs<Real>& cutoffs);
};

/// The splats of sixteen Gaussians without their colours.
template <class Real> struct SplatLanes {
    Splat<Lanes<Real>> splats;
    Rectangle<Lanes<Real>> bounds;
    Lanes<Real> depth;
    LensShape<Real> lens_shapes[kLanes];  ///< through a lens only

    /// Returns the splat of a visible Gaussian. Its colour is undefined.
    Splat<Real> splat(int lane) const {
        const auto& s = splats;
        return {
            {s.mean.x[lane], s.mean.y[lane]}, s.a[lane], s.b[lane], s.c[lane], s.opacity[lane], {}, s.threshold[lane]};
    }
    PixelBounds pixel_bounds(int lane) const {
        return {int(bounds.x_min[lane]), int(bounds.x_max[lane]), int(bounds.y_min[lane]), int(bounds.y_max[lane])};
    }
};

/// Applies make_splat to the Gaussians first, first + 1, ..., at most sixteen and below `count`. Returns a bit for each
/// that is not culled, and computes its result; other lanes are undefined. The result of a Gaussian does not depend on
/// its neighbours.
template <class Real>
unsigned make_splats(const ParameterView<Real>& params, std::int64_t first, const ViewLanes<Real>& view,
                     SplatLanes<Real>& out);

/// Adds the tiles that a splat touches, row by row. Returns their number. Bounds beyond the last tile of a row are
/// those of wrapped_bounds().
template <class Real>
std::uint32_t add_tiles(const Splat<Real>& s, const PixelBounds& bounds, int tiles_x,
                        std::vector<std::uint32_t>& tiles);

}  // namespace gs
