// SPDX-License-Identifier: Apache-2.0
// Codes of a Gaussian's geometry and base colour: 16 bytes in .ngsplat files (docs/formats.md#scenengsplat). Rounding
// is to the nearest code, ties to even.
#pragma once

#include <array>
#include <cstdint>

#include "appearance/packing.h"

namespace gs {

/// The range of base colours, d = code * scale + offset, shared by all channels of all Gaussians.
struct BaseRange {
    float scale = 1, offset = 0;
};

using GeometryWords = std::array<std::uint32_t, 4>;

/// The values encoded in the words.
struct PackedGeometry {
    std::array<double, 3> base;      ///< base colour, including the colour activation's shift if it has one
    double opacity;                  ///< 0..1
    std::array<double, 3> mean;      ///< frame units; within +-65504
    std::array<double, 3> scale;     ///< standard deviations, frame units
    std::array<double, 4> rotation;  ///< x, y, z, w; any length but 0
};

/// Returns the code of a standard deviation. Code 0 is 0; the other codes are e^-12 to e^9 in steps of 8.6 %. Values
/// outside this range are clamped.
int scale_code(double scale);
/// Returns the standard deviation of a code, frame units.
double decode_scale(int code);

/// Returns the codes of the octahedral axis (u, v) and the angle.
std::array<int, 3> rotation_codes(const std::array<double, 4>& xyzw);
/// Returns the unit quaternion x, y, z, w for the codes.
std::array<double, 4> decode_rotation(const std::array<int, 3>& codes);

/// Returns the code of one channel of the base colour, 0..255.
int base_code(double value, const BaseRange& range);

/// Packs the values into 16 bytes.
GeometryWords encode_geometry(const PackedGeometry& geometry, const BaseRange& range);
/// Returns the values encoded in the words.
PackedGeometry decode_geometry(const GeometryWords& words, const BaseRange& range);

/// Returns the range that minimizes the error of the activated colour with its packed residual, over a few directions.
/// `shift` is added to the base colours. Without Gaussians returns the default range.
BaseRange find_base_range(const Gaussians& gaussians, double shift, const Packing& packing,
                          const PackedAppearance& packed);

/// Replaces rotation and scale by the equivalent pair whose rounded rotation changes the outline least. An ellipsoid
/// has 24 equivalent pairs: its axes in any right-handed order and direction. A rotation of equal axes into each other
/// does not change the outline. The new rotation has length 1.
void choose_axes(PackedGeometry& geometry);

}  // namespace gs
