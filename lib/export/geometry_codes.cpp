// SPDX-License-Identifier: Apache-2.0
// Encodes and decodes a Gaussian's geometry and base colour.
#include "lib/export/geometry_codes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "kernels/base/half.h"

namespace gs {
namespace {

constexpr double kLnSmallest = -12, kLnRange = 21;  // range of standard deviations, natural logarithms

/// Returns the nearest whole number within 0..255.
int byte_code(double x) { return int(std::clamp(std::nearbyint(x), 0.0, 255.0)); }

std::uint32_t word(int a, int b, int c, int d) {
    return std::uint32_t(a) | std::uint32_t(b) << 8 | std::uint32_t(c) << 16 | std::uint32_t(d) << 24;
}
int byte(std::uint32_t word, int i) { return int(word >> (8 * i) & 0xff); }

double sign(double x) { return x < 0 ? -1 : 1; }

}  // namespace

int scale_code(double scale) {
    if (scale == 0) return 0;
    const double steps = (std::log(std::max(scale, 1e-30)) - kLnSmallest) * 254 / kLnRange;
    return int(std::min(255.0, 1 + std::nearbyint(std::max(0.0, steps))));
}

double decode_scale(int code) { return code == 0 ? 0 : std::exp(kLnSmallest + (code - 1) * kLnRange / 254); }

std::array<int, 3> rotation_codes(const std::array<double, 4>& xyzw) {
    const double norm = std::hypot(std::hypot(xyzw[0], xyzw[1]), std::hypot(xyzw[2], xyzw[3]));
    const double s = (xyzw[3] < 0 ? -1 : 1) / norm;
    const double w = std::min(xyzw[3] * s, 1.0), half = std::sqrt(std::max(0.0, 1 - w * w));
    double x = 1, y = 0, z = 0;
    if (half >= 1e-6) x = xyzw[0] * s / half, y = xyzw[1] * s / half, z = xyzw[2] * s / half;
    const double sum = std::abs(x) + std::abs(y) + std::abs(z);
    double u = x / sum, v = y / sum;
    if (z < 0) {
        const double folded = (1 - std::abs(v)) * sign(u);
        v = (1 - std::abs(u)) * sign(v);
        u = folded;
    }
    return {byte_code((u * 0.5 + 0.5) * 255), byte_code((v * 0.5 + 0.5) * 255),
            byte_code(2 * std::acos(w) / std::numbers::pi * 255)};
}

std::array<double, 4> decode_rotation(const std::array<int, 3>& codes) {
    double u = codes[0] / 255.0 * 2 - 1, v = codes[1] / 255.0 * 2 - 1;
    const double z = 1 - std::abs(u) - std::abs(v);
    if (z < 0) {
        const double folded = (1 - std::abs(v)) * sign(u);
        v = (1 - std::abs(u)) * sign(v);
        u = folded;
    }
    const double angle = codes[2] / 255.0 * std::numbers::pi,
                 s = std::sin(angle / 2) / std::sqrt(u * u + v * v + z * z);
    return {u * s, v * s, z * s, std::cos(angle / 2)};
}

int base_code(double value, const BaseRange& range) { return byte_code((value - range.offset) / range.scale); }

GeometryWords encode_geometry(const PackedGeometry& g, const BaseRange& range) {
    const auto q = rotation_codes(g.rotation);
    const auto half = [&](int i) { return int(half_bits(g.mean[std::size_t(i)])); };
    return {word(base_code(g.base[0], range), base_code(g.base[1], range), base_code(g.base[2], range),
                 byte_code(255 * g.opacity)),
            std::uint32_t(half(0)) | std::uint32_t(half(1)) << 16,
            std::uint32_t(half(2)) | std::uint32_t(q[0]) << 16 | std::uint32_t(q[1]) << 24,
            word(scale_code(g.scale[0]), scale_code(g.scale[1]), scale_code(g.scale[2]), q[2])};
}

PackedGeometry decode_geometry(const GeometryWords& w, const BaseRange& range) {
    PackedGeometry g;
    for (int c = 0; c < 3; ++c) {
        g.base[std::size_t(c)] = byte(w[0], c) * double(range.scale) + range.offset;
        g.scale[std::size_t(c)] = decode_scale(byte(w[3], c));
    }
    g.opacity = byte(w[0], 3) / 255.0;
    g.mean = {half_value(std::uint16_t(w[1])), half_value(std::uint16_t(w[1] >> 16)), half_value(std::uint16_t(w[2]))};
    g.rotation = decode_rotation({byte(w[2], 2), byte(w[2], 3), byte(w[3], 3)});
    return g;
}

}  // namespace gs
