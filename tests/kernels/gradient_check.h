// SPDX-License-Identifier: Apache-2.0
// Analytic gradients of a rendered picture against central differences in double.
#pragma once

#include <gtest/gtest.h>

#include "tests/kernels/random_scene.h"

namespace gs::test {

/// Compares gradients, of all parameters and of the camera. Errors are relative to the largest gradient of the same
/// group, whose rounding is in entries that cancel to nearly nothing.
struct GradientCheck {
    double tolerance = 1e-6;
    /// For focal lengths and principal point of a lens, whose gradients are right for splats that are small
    /// (docs/math/rasterizer.md#camera-gradient). 0: they are not compared.
    double lens_tolerance = 0;
    bool only_camera = false;
    int checked = 0, nonzero = 0;
    double worst = 0, worst_of_camera = 0;

    template <class Model>
    void run(GaussianState<double> s, const CameraParams<double>& camera, const Vec3<double>& background,
             const std::vector<double>& weights) {
        Pipeline<double, Model> pipe;
        pipe.render(s, camera, background);
        const GaussianState<double> analytic = pipe.gradients(s, weights);
        const auto sum_of = [&](const CameraParams<double>& from) {
            pipe.render(s, from, background);
            return pipe.weighted_sum(weights);
        };
        // Returns the least error of a gradient against differences of sum_at(h), in which the parameter is moved by h.
        const auto error_of = [&](double expected, double scale, double allowed, auto&& sum_at) {
            // A fragment that crosses alpha = 1/255 between the two renders is a jump of the image, not a slope:
            // another step size avoids it. A wrong gradient matches none.
            double error = 1e9;
            for (const double h : {1e-5, 2e-6, 4e-7, 8e-8}) {
                const double fd = (sum_at(h) - sum_at(-h)) / (2 * h);
                error = std::min(error, std::abs(fd - expected) / std::max({std::abs(expected), 1e-2 * scale, 1e-4}));
                if (error <= allowed) break;
            }
            return error;
        };
        double of_camera[CameraGradient<double>::kSize], camera_scale = 0;
        std::copy(std::begin(pipe.of_camera), std::end(pipe.of_camera), of_camera);
        for (double x : of_camera) camera_scale = std::max(camera_scale, std::abs(x));
        for (int k = 0; k < CameraGradient<double>::kSize; ++k) {
            const double allowed = k < 6 || camera.lens.is_pinhole() ? tolerance : lens_tolerance;
            if (allowed == 0) continue;
            const double error = error_of(of_camera[k], camera_scale, allowed,
                                          [&](double h) { return sum_of(moved_camera(camera, k, h)); });
            EXPECT_LE(error, allowed) << "camera[" << k << "] analytic " << of_camera[k];
            worst_of_camera = std::max(worst_of_camera, error);
        }
        if (only_camera) return;
        const auto check = [&](std::vector<double>& values, const std::vector<double>& expected, const char* name) {
            double scale = 0;
            for (double x : expected) scale = std::max(scale, std::abs(x));
            for (std::size_t k = 0; k < values.size(); ++k) {
                const double error = error_of(expected[k], scale, tolerance, [&](double h) {
                    const double x = std::exchange(values[k], values[k] + h), sum = sum_of(camera);
                    values[k] = x;
                    return sum;
                });
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
