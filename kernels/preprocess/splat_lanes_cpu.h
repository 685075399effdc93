// SPDX-License-Identifier: Apache-2.0
// Sixteen Gaussians at a time to splats, and the tiles that a splat touches, on the CPU.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/splat/gaussian_rows_device.h"

namespace gs {

/// The view of a camera, as sixteen Gaussians need it at once.
template <class Real> struct ViewLanes {
    CameraParams<Lanes<Real>> camera;
    Lanes<Real> width_padded, height_padded;  ///< of the grid of whole tiles
    Lanes<Real> min_opacity, inverse_alpha;

    static ViewLanes of(const CameraParams<Real>& camera, int width_padded, int height_padded,
                        const Cutoffs<Real>& cutoffs);
};

/// The splats of sixteen Gaussians without their colours.
template <class Real> struct SplatLanes {
    Splat<Lanes<Real>> splats;
    Rectangle<Lanes<Real>> bounds;
    Lanes<Real> depth;

    /// Returns a splat that is shown. Its colour is undefined.
    Splat<Real> splat(int lane) const {
        const auto& s = splats;
        return {
            {s.mean.x[lane], s.mean.y[lane]}, s.a[lane], s.b[lane], s.c[lane], s.opacity[lane], {}, s.threshold[lane]};
    }
    PixelBounds pixel_bounds(int lane) const {
        return {int(bounds.x_min[lane]), int(bounds.x_max[lane]), int(bounds.y_min[lane]), int(bounds.y_max[lane])};
    }
};

/// Does for the Gaussians first, first + 1, ... what make_splat does for one. At most sixteen are left out of `count`.
/// Returns a bit for each that is not culled, and computes what is defined for these. The results of a Gaussian do not
/// depend on those beside it.
template <class Real>
unsigned make_splats(const ParameterView<Real>& params, std::int64_t first, const ViewLanes<Real>& view,
                     SplatLanes<Real>& out);

/// Adds the tiles that a splat touches, row by row. Returns how many there are.
template <class Real>
std::uint32_t add_tiles(const Splat<Real>& s, const PixelBounds& bounds, int tiles_x,
                        std::vector<std::uint32_t>& tiles);

}  // namespace gs
