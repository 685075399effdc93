// SPDX-License-Identifier: Apache-2.0
// What the host knows of spherical Voronoi: parameters, learning rates, first values.
#include "appearance/model_info.h"

#include <algorithm>
#include <cmath>

#include "appearance/sv/packing.h"
#include "appearance/sv/stability.h"
#include "appearance/sv/sv.h"

namespace gs::appearance {
namespace {

constexpr int kSites = Sv::kMaxResidual / Sv::kPerSite;

AppearanceRates sv_rates(int sites, const RateContext&) {
    // Sites and temperatures wait for geometry until iteration 1000, fall to a tenth by 27 000 and rest from then on.
    const auto delayed = [](double rate) { return Schedule::cosine(rate, 1000, 27000, 0.1, 0, true); };
    const Schedule color = Schedule::constant(0.0008), site = delayed(0.002), temperature = delayed(0.006);
    AppearanceRates rates{color, {}};
    for (int i = 0; i < sites; ++i)
        rates.residual.insert(rates.residual.end(), {site, site, site, temperature, color, color, color});
    return rates;
}

/// Puts the sites on a Fibonacci lattice, with temperature 1 and colours 0.
void sv_init(int sites, float* row) {
    for (int i = 0; i < sites; ++i, row += Sv::kPerSite) {
        const double p = i + 0.5, y = 1 - 2 * p / sites, r = std::sqrt(1 - y * y),
                     angle = M_PI * (3 - std::sqrt(5.0)) * p;
        row[0] = float(r * std::cos(angle)), row[1] = float(y), row[2] = float(r * std::sin(angle));
        std::fill_n(row + 3, 4, 0.0f);
    }
}

}  // namespace

const ModelInfo& sv_info() {
    static const ModelInfo info = [] {
        ModelInfo m;
        m.name = "sv";
        m.summary = "spherical Voronoi: seven colours on the sphere, blended by distance";
        m.operations = 45 * kSites, m.operations_backward = 120 * kSites;
        m.default_max_degree = m.max_degree_limit = m.initial_degree = kSites;
        m.residual_width = [](int sites) { return Sv::kPerSite * sites; };
        m.rates = sv_rates;
        m.init_residual = sv_init;
        m.stability = sv_stability;
        m.residual = &model_residual<Sv, double>;
        m.packing = &sv_packing();
        return m;
    }();
    return info;
}

}  // namespace gs::appearance
