// SPDX-License-Identifier: Apache-2.0
// Analytic gradients of a rendered picture against central differences in double.
#pragma once

#include <gtest/gtest.h>

#include "tests/kernels/random_scene.h"

namespace gs::test {

/// Compares gradients. Errors are relative to the largest gradient of the same group, whose rounding is in entries that
/// cancel to nearly nothing.
struct GradientCheck {
    double tolerance = 1e-6;
    int checked = 0, nonzero = 0;
    double worst = 0;

    template <class Model>
    void run(GaussianState<double> s, const CameraParams<double>& camera, const Vec3<double>& background,
             const std::vector<double>& weights) {
        Pipeline<double, Model> pipe;
        pipe.render(s, camera, background);
        const GaussianState<double> analytic = pipe.gradients(s, weights);
        const auto check = [&](std::vector<double>& values, const std::vector<double>& expected, const char* name) {
            double scale = 0;
            for (double x : expected) scale = std::max(scale, std::abs(x));
            for (std::size_t k = 0; k < values.size(); ++k) {
                // A fragment that crosses alpha = 1/255 between the two renders is a jump of the image, not a slope:
                // another step size avoids it. A wrong gradient matches none.
                double error = 1e9;
                for (const double h : {1e-5, 2e-6, 4e-7}) {
                    const double x = values[k];
                    values[k] = x + h;
                    pipe.render(s, camera, background);
                    const double up = pipe.weighted_sum(weights);
                    values[k] = x - h;
                    pipe.render(s, camera, background);
                    const double down = pipe.weighted_sum(weights);
                    values[k] = x;
                    const double fd = (up - down) / (2 * h);
                    error = std::min(
                        error, std::abs(fd - expected[k]) / std::max({std::abs(expected[k]), 1e-2 * scale, 1e-4}));
                    if (error <= tolerance) break;
                }
                EXPECT_LE(error, tolerance) << name << "[" << k << "] analytic " << expected[k];
                worst = std::max(worst, error);
                ++checked;
                nonzero += expected[k] != 0;
            }
        };
        for (int g = 0; g < kNumGroups; ++g)
            if (g != int(Group::kSmoothing))  // it has no gradient
                check(s.groups[g].param, analytic.groups[g].param, kGroupNames[g]);
        check(s.shared.param, analytic.shared.param, "shared");
        ::testing::Test::RecordProperty("worst_relative_error", std::to_string(worst));
    }
};

}  // namespace gs::test
