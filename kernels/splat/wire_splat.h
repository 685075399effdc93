// SPDX-License-Identifier: Apache-2.0
// A splat as one rank of a training sends it to the rank that renders its view.
#pragma once

#include "kernels/splat/projection_device.h"
#include "kernels/splat/splat_device.h"

namespace gs {

/// What sorting and blending need of a Gaussian in one view.
struct WireSplat {
    float mean_x, mean_y;    ///< pixels
    float a, b, c;           ///< conic, as in Splat
    float opacity;           ///< activated
    float red, green, blue;  ///< after the colour activation
    float cov_xx, cov_yy;    ///< diagonal of the dilated 2-D covariance. The conic's inverse loses it for needles.
    float depth;             ///< along the camera's axis, frame units

    static GS_HD WireSplat of(const Splat<float>& s, const Sym2<float>& cov2d, float depth) {
        return {s.mean.x,  s.mean.y,  s.a,       s.b,      s.c,      s.opacity,
                s.color.x, s.color.y, s.color.z, cov2d.xx, cov2d.yy, depth};
    }
    GS_HD Splat<float> splat(float inverse_alpha) const {
        return {{mean_x, mean_y}, a, b, c, opacity, {red, green, blue}, splat_threshold(opacity, inverse_alpha)};
    }
    GS_HD PixelBounds bounds(const Splat<float>& s, int width_padded, int height_padded) const {
        return pixel_bounds(s.mean, Sym2<float>{cov_xx, 0, cov_yy}, touch_threshold(s), width_padded, height_padded);
    }
};
static_assert(sizeof(WireSplat) == 48);

}  // namespace gs
