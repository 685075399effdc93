// SPDX-License-Identifier: Apache-2.0
#include "packing.h"

#include "toy.h"

namespace gs::appearance {
namespace {

PackedAppearance prepare(const Gaussians& g) {
    PackedHeader header;
    header.model = packing_description("toy").id;
    header.features = std::uint32_t(g.active_degree);
    return make_packed(header, g);
}

void pack_row(const Gaussians& g, std::int64_t row, PackedAppearance& packed) {
    if (packed.header.features == 0) return;
    for (int k = 0; k < 9; ++k) set_half(packed, row, k, double(g[Group::kResidual].param[std::size_t(9 * row + k)]));
}

Vec3<double> residual(const PackedAppearance& packed, std::int64_t row, const Vec3<double>& direction) {
    double m[9] = {};
    for (int k = 0; k < 9 * int(packed.header.features); ++k) m[k] = get_half(packed, row, k);
    return Toy::residual(m, direction, 1);
}

}  // namespace

const Packing& toy_packing() {
    static const Packing packing{&packing_description("toy"), prepare, pack_row, residual};
    return packing;
}

}  // namespace gs::appearance
