// SPDX-License-Identifier: Apache-2.0
// A splat as a rank sends it to the rank that renders its view, and the places of splats in a step's view.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "kernels/base/portable.h"
#include "kernels/splat/projection_device.h"
#include "kernels/splat/splat_device.h"

namespace gs {

/// Row number of a splat that only pads an array.
inline constexpr std::uint32_t kNowhere = 0xffffffff;

/// The places in a view of the splats of 32 consecutive Gaussians: one bit for each Gaussian that has a splat, and the
/// place of the first splat. The others follow it.
struct SplatPlaces {
    std::uint32_t shown, first;

    GS_HD bool shows(unsigned k) const { return shown >> k & 1; }
#if defined(__CUDACC__)
    __device__ std::uint32_t place(unsigned k) const { return first + unsigned(__popc(shown & ((1u << k) - 1))); }
#endif
};

/// Largest side in pixels of an image whose splats can be sent.
inline constexpr int kMaxWireSide = 0xffff;

/// The data of a Gaussian that sorting and blending of one view need. Through a lens the splat lies on a face, and its
/// receiver finds the outline on screen.
struct alignas(16) WireSplat {
    float mean_x, mean_y;    ///< pixels
    float a, b, c;           ///< conic, as in Splat; through a lens as in LensShape
    float opacity;           ///< activated
    float red, green, blue;  ///< after the colour activation
    std::uint32_t x_min_max,
        y_min_max;  ///< pixels that it may reach: first | end << 16; through a lens the face, and 0
    float depth;    ///< depth_of() the mean, frame units

    static GS_HD WireSplat of(const Splat<float>& s, const PixelBounds& b, float depth) {
        const auto range = [](int first, int end) {
            return std::uint32_t(first) | std::uint32_t(gs_min(end, kMaxWireSide)) << 16;
        };
        return of(s, range(b.x_min, b.x_max), range(b.y_min, b.y_max), depth);
    }
    /// Returns a splat with this shape through a lens.
    static GS_HD WireSplat of(Splat<float> s, const LensShape<float>& shape, float depth) {
        s.mean = {shape.mx, shape.my}, s.a = shape.qa, s.b = shape.qb, s.c = shape.qc;
        return of(s, std::uint32_t(shape.face()), 0, depth);
    }
    /// Returns what the splat says of its shape through a lens: the mean and the conic.
    GS_HD LensShape<float> lens_shape() const { return {mean_x, mean_y, a, b, c, {}, 0, true}; }
    GS_HD int face() const { return int(x_min_max); }
    GS_HD Splat<float> splat(float inverse_alpha) const {
        return {{mean_x, mean_y}, a, b, c, opacity, {red, green, blue}, splat_threshold(opacity, inverse_alpha)};
    }
    /// Returns the pixels that the splat may reach in an image padded to whole tiles, whose size differs between
    /// backends.
    GS_HD PixelBounds bounds(int width_padded, int height_padded) const {
        return {int(x_min_max & 0xffff), gs_min(int(x_min_max >> 16), width_padded), int(y_min_max & 0xffff),
                gs_min(int(y_min_max >> 16), height_padded)};
    }

  private:
    static GS_HD WireSplat of(const Splat<float>& s, std::uint32_t x, std::uint32_t y, float depth) {
        return {s.mean.x, s.mean.y, s.a, s.b, s.c, s.opacity, s.color.x, s.color.y, s.color.z, x, y, depth};
    }
};
static_assert(sizeof(WireSplat) == 48);

}  // namespace gs
