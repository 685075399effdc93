// SPDX-License-Identifier: Apache-2.0
// The degenerate sites that the stability measurement tries.
#include "appearance/sv/stability.h"

#include <cmath>

#include "appearance/sv/sv.h"

namespace gs::appearance {
namespace {

constexpr int kSites = Sv::kMaxResidual / Sv::kPerSite;

/// Returns sites on the axes (exact in float) and one between them, all of different colours. Site 0 is +z.
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

}  // namespace

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

}  // namespace gs::appearance
