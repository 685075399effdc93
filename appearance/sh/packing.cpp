// SPDX-License-Identifier: Apache-2.0
#include "appearance/sh/packing.h"

#include <algorithm>
#include <cmath>

#include "appearance/sh/sh.h"

namespace gs::appearance {
namespace {

constexpr int kBands = 3;

/// Coefficients of a band, and where they begin in a row of residuals.
constexpr int num_fields(int band) { return 3 * (2 * band + 1); }
constexpr int first_field(int band) { return 3 * (band * band - 1); }

int degree_of(const PackedHeader& header) {
    int degree = 0;
    while (degree < kBands && (header.bands >> (degree + 1) & 1)) ++degree;
    return degree;
}

PackedLayout layout(const PackedHeader& header) {
    const int degree = degree_of(header);
    require_packed(header.bands == (2u << degree) - 2, "shBandMask", header.bands, "bands 1 to at most 3 without a gap");
    return {{kPackedShWords, kPackedShWords + degree}, 0};
}

/// Largest code of a band.
constexpr int code_limit(int band) { return (1 << (kPackedShBits[band - 1] - 1)) - 1; }

PackedAppearance prepare(const Gaussians& g) {
    const auto& residual = g[Group::kResidual];
    const int degree = residual.width == 0 ? 0 : g.active_degree;
    PackedHeader header;
    header.model = PackedModel::kSh;
    header.bands = (2u << degree) - 2;
    for (int band = 1; band <= degree; ++band) {
        float largest = 1e-8f;
        for (std::int64_t i = 0; i < g.count; ++i) {
            const float* row = residual.param.data() + i * residual.width + first_field(band);
            for (int f = 0; f < num_fields(band); ++f) largest = std::max(largest, std::abs(row[f]));
        }
        header.band_scales[std::size_t(band - 1)] = largest;
    }
    return make_packed(header, layout(header), g.count);
}

void pack_row(const Gaussians& g, std::int64_t row, PackedAppearance& packed) {
    const auto& residual = g[Group::kResidual];
    for (int band = 1; band <= degree_of(packed.header); ++band) {
        const double limit = code_limit(band), scale = packed.header.band_scales[std::size_t(band - 1)];
        std::uint32_t* words = packed.textures[std::size_t(band - 1)].data() + row * kPackedShWords[band - 1];
        const float* coefficients = residual.param.data() + row * residual.width + first_field(band);
        for (int f = 0; f < num_fields(band); ++f)
            set_field(words, kPackedShBits[band - 1], f, int(std::clamp(std::nearbyint(coefficients[f] / scale * limit), -limit, limit)));
    }
}

Vec3<double> residual(const PackedAppearance& packed, std::int64_t row, const Vec3<double>& direction) {
    const int degree = degree_of(packed.header);
    double coefficients[Sh::kMaxResidual] = {};
    for (int band = 1; band <= degree; ++band) {
        const int bits = kPackedShBits[band - 1];
        const std::uint32_t* words = packed.textures[std::size_t(band - 1)].data() + row * kPackedShWords[band - 1];
        const double step = double(packed.header.band_scales[std::size_t(band - 1)]) / code_limit(band);
        for (int f = 0; f < num_fields(band); ++f) coefficients[first_field(band) + f] = step * get_field(words, bits, f);
    }
    return packed_activation(packed.header.activation, Sh::residual(coefficients, direction, degree));
}

}  // namespace

void set_field(std::uint32_t* words, int bits, int f, int value) {
    const int bit = f * bits, shift = bit % 32;
    const std::uint64_t mask = ((std::uint64_t(1) << bits) - 1) << shift, field = (std::uint64_t(std::uint32_t(value)) << shift) & mask;
    words += bit / 32;
    words[0] = (words[0] & ~std::uint32_t(mask)) | std::uint32_t(field);
    if (shift + bits > 32) words[1] = (words[1] & ~std::uint32_t(mask >> 32)) | std::uint32_t(field >> 32);
}

int get_field(const std::uint32_t* words, int bits, int f) {
    const int bit = f * bits, shift = bit % 32;
    words += bit / 32;
    std::uint64_t value = words[0];
    if (shift + bits > 32) value |= std::uint64_t(words[1]) << 32;
    const int code = int(value >> shift & ((1u << bits) - 1));
    return code >= 1 << (bits - 1) ? code - (1 << bits) : code;
}

const Packing& sh_packing() {
    static const Packing packing{PackedModel::kSh, prepare, pack_row, layout, residual};
    return packing;
}

}  // namespace gs::appearance
