// SPDX-License-Identifier: Apache-2.0
// Host-side description of spherical Voronoi: parameters, learning rates, initial values, packing for viewers, and
// degenerate cases for the stability measurement.
#include <algorithm>
#include <cmath>

#include "appearance/model_info.h"
#include "appearance/packing.h"
#include "appearance/sv/sv.h"

namespace gs::appearance {
namespace {

// SV in files for viewers: seven halves per site, namely its direction as a unit vector, temperature and colour
// (docs/formats.md#scenengsplat).

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

const Packing& sv_packing() {
    static const Packing packing{&packing_description("sv"), prepare, pack_row, residual};
    return packing;
}

constexpr int kSites = Sv::kMaxResidual / Sv::kPerSite;

/// Returns sites on the axes (exact in float) and one site between them, all with different colours. Site 0 is +z.
std::vector<double> sites_on_axes(double raw_temperature) {
    const double sites[kSites][3] = {{0, 0, 1},  {1, 0, 0},  {0, 1, 0},       {-1, 0, 0},
                                     {0, -1, 0}, {0, 0, -1}, {0.6, -0.7, 0.4}};
    std::vector<double> rows;
    for (int i = 0; i < kSites; ++i) {
        rows.insert(rows.end(), std::begin(sites[i]), std::end(sites[i]));
        rows.insert(rows.end(), {raw_temperature, 0.9 - 0.1 * i, std::sin(i + 1.0), 0.2 * i * i - 1});
    }
    return rows;
}

std::array<double, 3> color(const std::vector<double>& rows, int site) {
    return {rows[7 * site + 4], rows[7 * site + 5], rows[7 * site + 6]};
}

void set_site(std::vector<double>& rows, int site, const std::array<double, 3>& raw) {
    for (int c = 0; c < 3; ++c) rows[7 * site + c] = raw[c];
}

constexpr double kTemperatures[] = {-1e4, -80, -5, 0, 3, 8, 10.9999, 11, 11.0001, 90, 1e4};

void add_sites(StabilityPlan& plan) {
    for (const double temperature : kTemperatures)
        for (const double distance : {0., 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3})
            for (const double azimuth : {0., 0.7, 2.5})
                for (const double side : {-1., 1.}) {
                    const std::array<double, 3> view{distance * std::cos(azimuth), distance * std::sin(azimuth), side};
                    const auto rows = sites_on_axes(temperature);
                    StabilityCase at{"view at a site", rows, view, {}, {}};
                    if (temperature >= 90) at.limit = color(rows, side > 0 ? 0 : 5), at.limit_name = "nearest colour";
                    if (temperature <= -80) {
                        at.limit = std::array<double, 3>{};
                        for (int c = 0; c < 3; ++c)
                            for (int i = 0; i < kSites; ++i) (*at.limit)[c] += color(rows, i)[c] / kSites;
                        at.limit_name = "mean colour";
                    }
                    plan.cases.push_back(at);

                    auto twins = rows;
                    set_site(twins, 1, {0, 0, 1});
                    if (temperature <= 0) twins[7 + 3] = 2;  // the two sites then differ in temperature
                    plan.cases.push_back({"coincident sites", twins, view, {}, {}});
                    for (int i = 2; i < kSites; ++i) set_site(twins, i, {0, 0, i % 2 ? -1. : 1.});
                    plan.cases.push_back({"opposite sites", twins, view, {}, {}});
                }
}

void add_lengths(StabilityPlan& plan) {
    for (const double temperature : kTemperatures)
        for (const double length : {0., 1e-45, 1e-38, 1e-20, 1e-13, 1e-12, 1e-8, 9.99e-7, 1e-6, 1.001e-6, 1e-3, 1e3,
                                    1e18, 1e20, 1e30, 1.9e38})
            for (const std::array<double, 3> view : {std::array{0.3, 0.8, -0.4}, {-0.5, -0.2, 0.9}, {1., 1., 1.}})
                for (const bool all : {false, true}) {
                    auto rows = sites_on_axes(temperature);
                    set_site(rows, 0, {length, -length, length});
                    for (int i = 1; all && i < kSites; ++i)
                        set_site(rows, i, {rows[7 * i] * length, rows[7 * i + 1] * length, rows[7 * i + 2] * length});
                    plan.cases.push_back({"short and long sites", rows, view, {}, {}});
                }
}

/// Returns the cases: views at a site and at its antipode, and at distances of 1e-8 to 1e-3 from them; coincident,
/// opposite, short, zero and huge sites; temperatures around the limit; all temperatures so high or so low that the
/// residual is at an exact limit.
StabilityPlan sv_stability() {
    StabilityPlan plan;
    for (int i = 0; i < kSites; ++i) {
        plan.column_kinds.insert(plan.column_kinds.end(), 3, "site");
        plan.column_kinds.push_back("temperature");
        plan.column_kinds.insert(plan.column_kinds.end(), 3, "colour");
    }
    add_sites(plan);
    add_lengths(plan);
    for (const double side : {-1e-3, -1e-7, 0., 1e-7, 1e-3})
        for (const std::array<double, 3> view : {std::array{0.3, 0.8, -0.4}, {0.01, 0.02, 1.}}) {
            auto rows = sites_on_axes(0);
            rows[3] = kLargestRawTemperature * (1 + side);
            plan.cases.push_back({"temperature", rows, view, {}, {}});
        }
    return plan;
}

AppearanceRates sv_rates(int sites, const RateContext&) {
    // The rates of sites and temperatures are 0 until iteration 1000, while geometry forms, fall to a tenth by 27 000
    // and then stay constant.
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
