// SPDX-License-Identifier: Apache-2.0
// Encodes and decodes a Gaussian's geometry and base colour, finds the range of base colours, and chooses the order and
// direction of an ellipsoid's axes.
#include "lib/export/geometry_codes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "appearance/contract.h"
#include "kernels/base/half.h"
#include "kernels/base/parallel.h"

namespace gs {
namespace {

constexpr double kLnSmallest = -12, kLnRange = 21;  // range of standard deviations, natural logarithms

/// Rounds to the nearest whole number and clamps to 0..255.
int byte_code(double x) { return int(std::clamp(std::nearbyint(x), 0.0, 255.0)); }

std::uint32_t word(int a, int b, int c, int d) {
    return std::uint32_t(a) | std::uint32_t(b) << 8 | std::uint32_t(c) << 16 | std::uint32_t(d) << 24;
}
int byte(std::uint32_t word, int i) { return int(word >> (8 * i) & 0xff); }

double sign(double x) { return x < 0 ? -1 : 1; }

/// The directions in which residuals are evaluated: corners of a tetrahedron.
constexpr std::size_t kNumDirections = 4;
const double kSide = std::sqrt(1.0 / 3);
const Vec3<double> kDirections[kNumDirections] = {
    {kSide, kSide, kSide}, {kSide, -kSide, -kSide}, {-kSide, kSide, -kSide}, {-kSide, -kSide, kSide}};

/// Returns a pixel's value for an unoccluded Gaussian on black. It is clamped to 1 after the product with the opacity,
/// so colours above 1 matter.
double shown(ColorActivation activation, double color, double opacity) {
    return std::min(opacity * color_activation(activation, color), 1.0);
}

/// One channel of a Gaussian.
struct Sample {
    double base, opacity, stands_for;
    double residual[kNumDirections], shown[kNumDirections];
};

std::vector<Sample> sample_channels(const Gaussians& g, const Packing& packing, const PackedAppearance& packed) {
    std::vector<Sample> samples;
    for (const SampledRow& sampled : sample_rows(g[Group::kBase], 0, 3)) {
        const float* base = g[Group::kBase].param.data() + 3 * sampled.row;
        const double opacity = sigmoid(double(g[Group::kOpacity].param[std::size_t(sampled.row)]));
        Sample channels[3];
        for (int c = 0; c < 3; ++c) channels[c] = {base[c], opacity, sampled.stands_for, {}, {}};
        for (std::size_t k = 0; k < kNumDirections; ++k) {
            const Vec3<double> residual = packed_residual(packing, packed, sampled.row, kDirections[k]);
            channels[0].residual[k] = residual.x, channels[1].residual[k] = residual.y,
            channels[2].residual[k] = residual.z;
            for (Sample& s : channels) s.shown[k] = shown(g.appearance.activation, s.base + s.residual[k], opacity);
        }
        samples.insert(samples.end(), channels, channels + 3);
    }
    return samples;
}

/// The least length of an axis, relative to the longest; thinner axes are treated as this thick, because a pixel blurs
/// them. In measurements 0.3 was equal, 0.01 worse.
constexpr double kThinnest = 0.1;

struct Relabelling {
    Eigen::Quaterniond rotation;
    std::array<std::size_t, 3> axis;  ///< new axis k is the old axis[k], perhaps reversed
};

/// Returns the rotations of a cube; the first is the identity.
std::vector<Relabelling> cube_rotations() {
    std::vector<Relabelling> all;
    for (int x = 0; x < 3; ++x) {
        for (int y = 0; y < 3; ++y) {
            for (int signs = 0; signs < 4 && x != y; ++signs) {
                Eigen::Matrix3d axes;
                axes.col(0) = Eigen::Vector3d::Unit(x) * (signs & 1 ? -1 : 1);
                axes.col(1) = Eigen::Vector3d::Unit(y) * (signs & 2 ? -1 : 1);
                axes.col(2) = axes.col(0).cross(axes.col(1));
                all.push_back({Eigen::Quaterniond(axes), {std::size_t(x), std::size_t(y), std::size_t(3 - x - y)}});
            }
        }
    }
    return all;
}

/// Returns the squared change of the outline, relative to its axes, of an ellipsoid under a rotation of a few degrees,
/// `turn` (radians about its own axes).
double visible_change(const Eigen::Vector3d& turn, const std::array<double, 3>& scale) {
    const double longest = *std::max_element(scale.begin(), scale.end());
    const auto thickness = [&](std::size_t k) { return longest > 0 ? std::max(scale[k % 3] / longest, kThinnest) : 1; };
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) {
        const double ratio = thickness(k + 1) / thickness(k + 2), change = turn[Eigen::Index(k)] * (ratio - 1 / ratio);
        sum += change * change;
    }
    return sum;
}

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

BaseRange find_base_range(const Gaussians& g, double shift, const Packing& packing, const PackedAppearance& packed) {
    if (g.count == 0) return {};
    const std::vector<Sample> samples = sample_channels(g, packing, packed);
    std::vector<float> values;
    for (const Sample& s : samples) values.push_back(float(s.base));
    std::sort(values.begin(), values.end());
    const std::vector<float> lows = possible_ends(values);
    std::reverse(values.begin(), values.end());
    std::vector<BaseRange> ranges;
    for (const float low : lows) {
        for (const float high : possible_ends(values))
            ranges.push_back({float(std::max(double(high) - low, 1e-6) / 255), float(low + shift)});
    }
    std::vector<double> errors(ranges.size());
    parallel_for(std::int64_t(ranges.size()), [&](std::int64_t r) {
        const BaseRange& range = ranges[std::size_t(r)];
        for (const Sample& s : samples) {
            const double base = base_code(s.base + shift, range) * double(range.scale) + range.offset - shift;
            for (std::size_t k = 0; k < kNumDirections; ++k) {
                const double difference = shown(g.appearance.activation, base + s.residual[k], s.opacity) - s.shown[k];
                errors[std::size_t(r)] += s.stands_for * difference * difference;
            }
        }
    });
    return ranges[std::size_t(std::min_element(errors.begin(), errors.end()) - errors.begin())];
}

void choose_axes(PackedGeometry& geometry) {
    static const std::vector<Relabelling> relabellings = cube_rotations();
    const Eigen::Quaterniond rotation = Eigen::Quaterniond(geometry.rotation.data()).normalized();
    const std::array<double, 3> scale = geometry.scale;
    double least = std::numeric_limits<double>::infinity();
    for (const Relabelling& relabelling : relabellings) {
        const Eigen::Quaterniond q = rotation * relabelling.rotation;
        const std::array<double, 4> xyzw = {q.x(), q.y(), q.z(), q.w()};
        const std::array<double, 3> relabelled = {scale[relabelling.axis[0]], scale[relabelling.axis[1]],
                                                  scale[relabelling.axis[2]]};
        const Eigen::Quaterniond decoded(decode_rotation(rotation_codes(xyzw)).data());
        const double change = visible_change(2 * (q.conjugate() * decoded).vec(), relabelled);
        if (change < least) least = change, geometry.rotation = xyzw, geometry.scale = relabelled;
    }
}

}  // namespace gs
