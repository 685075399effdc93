// SPDX-License-Identifier: Apache-2.0
// The degenerate lobes that the stability measurement tries.
#include "appearance/nasg/stability.h"

#include <algorithm>
#include <cmath>

#include "appearance/nasg/nasg.h"

namespace gs::appearance {
namespace {

/// Raw amplitudes of the cases with known limits: saturated either way, and ordinary.
constexpr double kAmplitudes[3] = {20, -20, 0.5};

template <class Model> std::vector<double> lobe(double angle, double raw_sharpness, double raw_anisotropy) {
    std::vector<double> raw = {angle, -angle, angle, raw_sharpness, raw_anisotropy};
    if (Model::kAmplitude == 6) raw.push_back(-1.6);
    raw.insert(raw.end(), std::begin(kAmplitudes), std::end(kAmplitudes));
    return raw;
}

/// Returns the world direction of local (vx, vy, vz) in the frame of zero angles, which is exact in float:
/// x = (0,0,-1), y = (-1,0,0), z = (0,1,0).
std::array<double, 3> unturned(double vx, double vy, double vz) { return {-vy, vz, -vx}; }

/// Returns the density at the axis, N = lambda sqrt(1+a) / (2 pi (1 - e^(-2 lambda))).
double peak(double raw_sharpness, double raw_anisotropy) {
    const double lambda = std::clamp(std::exp(raw_sharpness), 1e-6, 1e4), a = std::min(std::exp(raw_anisotropy), 1e4);
    return lambda * std::sqrt(1 + a) / (2 * M_PI * -std::expm1(-2 * lambda));
}

template <class Model> void add_poles(StabilityPlan& plan) {
    const double shapes[][2] = {
        {std::log(0.5), std::log(0.5)}, {-1e4, -1e4}, {-16, 1}, {std::log(100), 2}, {2, 1e4}, {1e4, -3}, {1e4, 1e4}};
    for (const auto& [sharpness, anisotropy] : shapes)
        for (const double distance : {0., 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 4e-4, 1e-3})
            for (const double azimuth : {0., 0.7, 1.5, 2.5}) {
                const double vx = distance * std::cos(azimuth), vy = distance * std::sin(azimuth);
                StabilityCase axis{"on the axis", lobe<Model>(0, sharpness, anisotropy), unturned(vx, vy, 1), {}, {}};
                StabilityCase antipode{"at the antipode", axis.residual, unturned(vx, vy, -1), {}, {}};
                if (distance == 0) {
                    const double n = peak(sharpness, anisotropy),
                                 bottom = n * std::exp(-2 * std::min(std::exp(sharpness), 1e4));
                    axis.limit = {n, -n, n * std::tanh(kAmplitudes[2])}, axis.limit_name = "N";
                    antipode.limit = {bottom, -bottom, bottom * std::tanh(kAmplitudes[2])},
                    antipode.limit_name = "N exp(-2 lambda)";
                }
                plan.cases.push_back(axis);
                plan.cases.push_back(antipode);
            }
}

template <class Model> void add_frames(StabilityPlan& plan) {
    for (const double angle : {7.0, kLargestRawAngle, 7.2544, 8.0, 1e4, 3.4e38})
        for (int signs = 0; signs < 8; ++signs)
            for (int axis = 0; axis < 3; ++axis)
                for (const double end : {-1., 1.})
                    for (const double off : {0., 1e-4, 0.1}) {
                        std::vector<double> raw = lobe<Model>(angle, 1, 0.5);
                        for (int k = 0; k < 3; ++k) raw[k] = signs & 1 << k ? angle : -angle;
                        std::array<double, 3> view{off, off, off};
                        view[axis] = end;
                        plan.cases.push_back({"frames at their limits", raw, view, {}, {}});
                    }
}

/// Adds cases with `column` at each value and up to 1e-3 of it to either side.
template <class Model> void add_around(StabilityPlan& plan, int column, std::initializer_list<double> values) {
    for (const double value : values)
        for (const double side : {-1e-3, -1e-7, 0., 1e-7, 1e-3})
            for (const std::array<double, 3> view : {std::array{0.3, 0.8, -0.4}, {-0.5, -0.2, 0.9}, {0.02, 1., 0.01}}) {
                std::vector<double> raw = lobe<Model>(0.3, -0.4, 0.6);
                raw[column] = value * (1 + side);
                plan.cases.push_back({plan.column_kinds[column], raw, view, {}, {}});
            }
}

}  // namespace

template <class Model> StabilityPlan lobe_stability() {
    StabilityPlan plan;
    plan.column_kinds = {"angles", "angles", "angles", "sharpness", "anisotropy"};
    if (Model::kAmplitude == 6) plan.column_kinds.push_back("carrier");
    plan.column_kinds.insert(plan.column_kinds.end(), 3, "amplitude");
    add_poles<Model>(plan);
    add_frames<Model>(plan);
    for (int angle = 0; angle < 3; ++angle) add_around<Model>(plan, angle, {-kLargestRawAngle, kLargestRawAngle});
    add_around<Model>(plan, 3, {kLargestRawShape, kSmallestRawSharpness, -12, -17});
    add_around<Model>(plan, 4, {kLargestRawShape, -15, -17});
    // From 9.01 on tanh is 1 in float, so that a slope computed from it would be 0; from 43 to 50 the slope itself
    // underflows.
    for (int k = 5; k < int(plan.column_kinds.size()); ++k)
        add_around<Model>(plan, k, {-50, -44, -43, -12, -9.01, 9.01, 12, 43, 44, 50});
    return plan;
}

template StabilityPlan lobe_stability<Nasg>();
template StabilityPlan lobe_stability<Nasgabor>();

}  // namespace gs::appearance
