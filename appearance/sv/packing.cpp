// SPDX-License-Identifier: Apache-2.0
// Packs sites as halves, and evaluates their colours from them.
#include "appearance/sv/packing.h"

#include <cmath>

#include "appearance/sv/sv.h"

namespace gs::appearance {
namespace {

constexpr int kPerSite = Sv::kPerSite;

PackedAppearance prepare(const Gaussians& g) {
    PackedHeader header;
    header.model = packing_description("sv").id;
    header.features = std::uint32_t(g.active_degree);
    return make_packed(header, g);
}

void pack_row(const Gaussians& g, std::int64_t row, PackedAppearance& packed) {
    const auto& residual = g[Group::kResidual];
    for (int s = 0; s < g.active_degree; ++s) {
        const float* raw = residual.param.data() + row * residual.width + s * kPerSite;
        const double site_raw[4] = {raw[0], raw[1], raw[2], raw[3]};
        const auto site = Sv::Site<double>::of(site_raw, {0, 0, 0});
        const double values[kPerSite] = {site.unit.x, site.unit.y, site.unit.z, site.temperature,
                                         raw[4],      raw[5],      raw[6]};
        for (int k = 0; k < kPerSite; ++k) set_half(packed, row, s * kPerSite + k, values[k]);
    }
}

Vec3<double> residual(const PackedAppearance& packed, std::int64_t row, const Vec3<double>& direction) {
    Sv::Softmax<double> softmax;
    Vec3<double> color{0, 0, 0};
    for (int s = 0; s < int(packed.header.features); ++s) {
        const auto at = [&](int k) { return get_half(packed, row, s * kPerSite + k); };
        const Vec3<double> offset = Vec3<double>{at(0), at(1), at(2)} - direction, site_color{at(4), at(5), at(6)};
        const auto [likelier, factor] = softmax.add(-at(3) * std::sqrt(dot(offset, offset)));
        color = likelier ? color * factor + site_color : color + site_color * factor;
    }
    return softmax.sum > 0 ? color * (1 / softmax.sum) : color;
}

}  // namespace

const Packing& sv_packing() {
    static const Packing packing{&packing_description("sv"), prepare, pack_row, residual};
    return packing;
}

}  // namespace gs::appearance
