// SPDX-License-Identifier: Apache-2.0
// Packs lobes as halves, and evaluates their colours from them.
#include "appearance/nasg/packing.h"

#include <algorithm>
#include <cmath>

#include "appearance/nasg/nasg.h"

namespace gs::appearance {
namespace {

template <class Model> constexpr bool kHasCarrier = Model::kAmplitude == 6;
template <class Model> const PackingDescription& description() {
    return packing_description(kHasCarrier<Model> ? "nasgabor" : "nasg");
}

template <class Model> PackedAppearance prepare(const Gaussians& g) {
    PackedHeader header;
    header.model = description<Model>().id;
    header.features = std::uint32_t(g.active_degree);
    return make_packed(header, g);
}

/// Writes for each lobe: axes x and z (6), 2 lambda, a, with a carrier k, N, amplitude (3).
template <class Model> void pack_row(const Gaussians& g, std::int64_t row, PackedAppearance& packed) {
    using Density = LobeDensity<double>;
    const auto& residual = g[Group::kResidual];
    int k = 0;
    const auto put = [&](double value) { set_half(packed, row, k++, value); };
    const auto put_vector = [&](const Vec3<double>& v) { put(v.x), put(v.y), put(v.z); };
    for (int lobe = 0; lobe < g.active_degree; ++lobe) {
        double raw[Model::kPerLobe];
        std::copy_n(residual.param.data() + row * residual.width + lobe * Model::kPerLobe, Model::kPerLobe, raw);
        const auto frame = Model::template Frame<double>::of(raw);
        const double t = Density::twice_sharpness(raw[3]), a = Density::anisotropy(raw[4]);
        const double norm = Density::norm(t, a), stored = std::min(norm, kLargestPackedNorm);
        put_vector(Model::from_lobe(frame.x));
        put_vector(Model::from_lobe(frame.z));
        put(t);
        put(a);
        if constexpr (kHasCarrier<Model>) put(Carrier<double>::of(raw[5], 0).frequency);
        put(stored);
        put_vector(Model::amplitude(raw) * (norm / stored));
    }
}

Vec3<double> normalized(const Vec3<double>& v) { return v * (1 / std::max(std::sqrt(dot(v, v)), 1e-12)); }

template <class Model>
Vec3<double> residual(const PackedAppearance& packed, std::int64_t row, const Vec3<double>& direction) {
    Vec3<double> sum{0, 0, 0};
    int k = 0;
    const auto get = [&] { return get_half(packed, row, k++); };
    const auto get_vector = [&] {
        const double x = get(), y = get(), z = get();
        return Vec3<double>{x, y, z};
    };
    for (std::uint32_t lobe = 0; lobe < packed.header.features; ++lobe) {
        // Rounded axes are neither of unit length nor perpendicular; without both, the lobe would have a rim around its
        // axis.
        const Vec3<double> stored_x = get_vector(), z = normalized(get_vector()),
                           x = normalized(stored_x - z * dot(stored_x, z)), y = cross(z, x);
        const Vec3<double> v{dot(x, direction), dot(y, direction), dot(z, direction)};
        const double t = get(), a = get();
        double carrier = 1;
        if constexpr (kHasCarrier<Model>) carrier = std::pow(std::cos(0.5 * get() * v.x), 2);
        const double norm = get();
        sum += get_vector() * (carrier * LobeDensity<double>::of_shape(v, t, a, norm).value);
    }
    return sum;
}

}  // namespace

template <class Model> const Packing& lobe_packing() {
    static const Packing packing{&description<Model>(), prepare<Model>, pack_row<Model>, residual<Model>};
    return packing;
}
template const Packing& lobe_packing<Nasg>();
template const Packing& lobe_packing<Nasgabor>();

}  // namespace gs::appearance
