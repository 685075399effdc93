// SPDX-License-Identifier: Apache-2.0
// The 16 bytes of a Gaussian's geometry and base colour in .ngsplat files (docs/formats.md#scenengsplat). Rounding is
// to the nearest code, ties to even.
#pragma once

#include <array>
#include <cstdint>

namespace gs {

/// d = code * scale + offset, of all channels of all Gaussians.
struct BaseRange {
    float scale = 1, offset = 0;
};

using GeometryWords = std::array<std::uint32_t, 4>;

/// What the words stand for.
struct PackedGeometry {
    std::array<double, 3> base;      ///< with the shift of the colour activation, where it has one
    double opacity;                  ///< 0..1
    std::array<double, 3> mean;      ///< world units; within +-65504
    std::array<double, 3> scale;     ///< standard deviations, world units
    std::array<double, 4> rotation;  ///< x, y, z, w; any length but 0
};

/// Code of a standard deviation: 0 is 0, others are e^-12 to e^9 in steps of 8.6 %; beyond counts as the nearest.
int scale_code(double scale);
double decode_scale(int code);

/// Octahedral axis (u, v) and angle.
std::array<int, 3> rotation_codes(const std::array<double, 4>& xyzw);
std::array<double, 4> decode_rotation(const std::array<int, 3>& codes);

int base_code(double value, const BaseRange& range);

GeometryWords encode_geometry(const PackedGeometry& geometry, const BaseRange& range);
PackedGeometry decode_geometry(const GeometryWords& words, const BaseRange& range);

}  // namespace gs
