// SPDX-License-Identifier: Apache-2.0
// Finds the range of base colours that a scene's 8-bit codes cover.
#include "lib/export/base_range.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "appearance/code_range.h"
#include "appearance/contract.h"
#include "kernels/base/parallel.h"

namespace gs {
namespace {

/// The directions in which residuals are evaluated: corners of a tetrahedron.
constexpr std::size_t kNumDirections = 4;
const double kSide = std::sqrt(1.0 / 3);
const Vec3<double> kDirections[kNumDirections] = {
    {kSide, kSide, kSide}, {kSide, -kSide, -kSide}, {-kSide, kSide, -kSide}, {-kSide, -kSide, kSide}};

/// Returns a pixel's value for an unoccluded Gaussian on black. A colour above 1 counts as long as its product with the
/// opacity is below 1.
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

}  // namespace

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

}  // namespace gs
