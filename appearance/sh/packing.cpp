// SPDX-License-Identifier: Apache-2.0
// Packs coefficients as low-bit codes, and evaluates residuals from the codes.
#include "appearance/sh/packing.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "appearance/packing.h"
#include "appearance/sh/sh.h"

namespace gs::appearance {
namespace {

constexpr int kBands = 3;

/// Return the number of coefficients of a band, and their offset in a residual row.
constexpr int num_fields(int band) { return 3 * (2 * band + 1); }
constexpr int first_field(int band) { return 3 * (band * band - 1); }

int degree_of(const PackedHeader& header) {
    int degree = 0;
    while (degree < kBands && (header.bands >> (degree + 1) & 1)) ++degree;
    return degree;
}

/// Returns the largest code of a band.
constexpr int code_limit(int band) { return (1 << (kPackedShBits[band - 1] - 1)) - 1; }

int code_of(double coefficient, double scale, int band) {
    const double limit = code_limit(band);
    return int(std::clamp(std::nearbyint(coefficient / scale * limit), -limit, limit));
}

/// Returns the error of the codes of one Gaussian's band: the squared error of a pixel that the Gaussian covers, at
/// most 1, averaged over directions (the basis functions are orthonormal) and summed over channels.
double visible_error(const float* coefficients, int band, double scale, double opacity) {
    double squares[3] = {}, sum = 0;
    for (int f = 0; f < num_fields(band); ++f) {
        const double difference = coefficients[f] - code_of(coefficients[f], scale, band) * scale / code_limit(band);
        squares[f % 3] += difference * difference;
    }
    for (const double square : squares) sum += std::min(1.0, opacity * opacity * square / (4 * std::numbers::pi));
    return sum;
}

/// Returns the coefficient represented by the largest code of a band: the largest of the scene, or a smaller value that
/// clips some coefficients if that gives a smaller visible error.
float find_band_scale(const Gaussians& g, int band) {
    const auto& residual = g[Group::kResidual];
    const auto coefficients = [&](std::int64_t row) {
        return residual.param.data() + row * residual.width + first_field(band);
    };
    const std::vector<SampledRow> rows = sample_rows(residual, first_field(band), num_fields(band));
    std::vector<float> sizes = {1e-8f};
    for (const SampledRow& sampled : rows) {
        for (int f = 0; f < num_fields(band); ++f)
            sizes.push_back(std::max(std::abs(coefficients(sampled.row)[f]), sizes.front()));
    }
    std::sort(sizes.rbegin(), sizes.rend());
    float best = 0;
    double least = INFINITY;
    for (const float scale : possible_ends(sizes)) {
        double error = 0;
        for (const SampledRow& sampled : rows) {
            const double opacity = sigmoid(double(g[Group::kOpacity].param[std::size_t(sampled.row)]));
            error += sampled.stands_for * visible_error(coefficients(sampled.row), band, scale, opacity);
        }
        if (error < least) least = error, best = scale;
    }
    return best;
}

PackedAppearance prepare(const Gaussians& g) {
    const int degree = g[Group::kResidual].width == 0 ? 0 : g.active_degree;
    PackedHeader header;
    header.model = packing_description("sh").id;
    header.floats.assign(kBands, 0);
    header.bands = (2u << degree) - 2;
    for (int band = 1; band <= degree; ++band) header.floats[std::size_t(band - 1)] = find_band_scale(g, band);
    return make_packed(header, g);
}

void pack_row(const Gaussians& g, std::int64_t row, PackedAppearance& packed) {
    const auto& residual = g[Group::kResidual];
    for (int band = 1; band <= degree_of(packed.header); ++band) {
        const float scale = packed.header.floats[std::size_t(band - 1)];
        std::uint32_t* words = packed.textures[std::size_t(band - 1)].data() + row * kPackedShWords[band - 1];
        const float* coefficients = residual.param.data() + row * residual.width + first_field(band);
        for (int f = 0; f < num_fields(band); ++f)
            set_field(words, kPackedShBits[band - 1], f, code_of(coefficients[f], scale, band));
    }
}

Vec3<double> residual(const PackedAppearance& packed, std::int64_t row, const Vec3<double>& direction) {
    const int degree = degree_of(packed.header);
    double coefficients[Sh::kMaxResidual] = {};
    for (int band = 1; band <= degree; ++band) {
        const int bits = kPackedShBits[band - 1];
        const std::uint32_t* words = packed.textures[std::size_t(band - 1)].data() + row * kPackedShWords[band - 1];
        const double step = double(packed.header.floats[std::size_t(band - 1)]) / code_limit(band);
        for (int f = 0; f < num_fields(band); ++f)
            coefficients[first_field(band) + f] = step * get_field(words, bits, f);
    }
    return packed_activation(packed.header.activation, Sh::residual(coefficients, direction, degree));
}

}  // namespace

void set_field(std::uint32_t* words, int bits, int f, int value) {
    const int bit = f * bits, shift = bit % 32;
    const std::uint64_t mask = ((std::uint64_t(1) << bits) - 1) << shift,
                        field = (std::uint64_t(std::uint32_t(value)) << shift) & mask;
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
    static const Packing packing{&packing_description("sh"), prepare, pack_row, residual};
    return packing;
}

}  // namespace gs::appearance
