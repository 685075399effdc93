// SPDX-License-Identifier: Apache-2.0
// Gaussians at the ends of what floats hold: nothing becomes NaN or infinite that was not, and the image is that of the
// CPU. Skipped where there is no device.
#include "tests/gpu/scenes.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();
constexpr int kWidth = 40, kHeight = 30;

class GpuExtremes : public Gpu {
  protected:
    /// Renders and trains 40 Gaussians after `change`. At most the share `share` of the values may be off by more than
    /// `tolerance`.
    void check(const std::string& what, const std::function<void(GaussianState<double>&)>& change,
               double tolerance = 1e-4, double share = 0.01) {
        SCOPED_TRACE(what);
        auto d = random_gaussians(40, 3, 9);
        separate_depths(d, test_camera(kWidth, kHeight));
        change(d);
        const Gaussians s = cast<float>(d);
        const auto cpu = make_cpu_backend(s.appearance), gpu = make_cuda_backend(s.appearance);
        RenderRequest r;
        r.camera = cast<float>(test_camera(kWidth, kHeight));
        r.background = {0.2f, 0.4f, 0.6f};
        RenderedImage a, b;
        cpu->upload(s), gpu->upload(s);
        cpu->render(r, a), gpu->render(r, b);
        std::size_t off = 0;
        for (std::size_t i = 0; i < a.rgb.size(); ++i) {
            ASSERT_TRUE(std::isfinite(b.rgb[i])) << "value " << i;
            off += std::abs(a.rgb[i] - b.rgb[i]) > tolerance;
        }
        EXPECT_LE(double(off), share * double(a.rgb.size()))
            << "values that differ from the CPU's by more than " << tolerance;
        for (float x : b.alpha) ASSERT_TRUE(x >= -1e-6f && x <= 1 + 1e-6f) << x;

        const RandomTarget target(kWidth, kHeight, 3);
        const StepRequest step = step_request(r.camera, target.image());
        gpu->step(step), gpu->step(step);
        gpu->synchronize();
        EXPECT_TRUE(std::isfinite(gpu->take_stats().loss));
        const Gaussians after = gpu->download(true);
        for (int g = 0; g < kNumGroups; ++g) {
            const auto &before = s.groups[g], &now = after.groups[g];
            for (std::size_t i = 0; i < now.m.size(); ++i) {
                if (!std::isfinite(before.param[i])) continue;
                ASSERT_TRUE(std::isfinite(now.param[i]) && std::isfinite(now.m[i]) && std::isfinite(now.v[i]))
                    << kGroupNames[g] << " " << i << ": " << now.param[i] << ", moments " << now.m[i] << " and "
                    << now.v[i];
            }
        }
    }
    static void set(GaussianState<double>& s, Group g, std::int64_t i, std::initializer_list<double> values) {
        std::copy(values.begin(), values.end(), s[g].param.begin() + i * std::int64_t(values.size()));
    }
};

TEST_F(GpuExtremes, Scales) {
    for (const double x : {-30.0, -10.0, -5.0, 3.0, 5.0, 8.0, 10.0, 14.0, 20.0, 30.0, 45.0, 1e30})
        for (const double y : {-30.0, -3.0, x}) {
            // Thin ones of 1000 and more pixels' length have variances of 1e6 and more, whose products cancel to a
            // determinant of 1e6 * 0.3: float has no digit to spare for that, and every evaluation shows something
            // else. Above e^12 they are culled.
            const bool arbitrary = x >= 5 && x < 12 && y != x;
            check(
                "scales " + std::to_string(x) + ", " + std::to_string(y),
                [&](auto& s) {
                    for (const std::int64_t i : {0, 7, 20}) set(s, Group::kScale, i, {x, y, y});
                },
                2e-3, arbitrary ? 1 : 0.01);
        }
}

TEST_F(GpuExtremes, AllScalesAtOnce) {
    for (const double x : {-30.0, 4.0, 30.0})
        check("all scales " + std::to_string(x),
              [&](auto& s) { std::fill(s[Group::kScale].param.begin(), s[Group::kScale].param.end(), x); });
}

TEST_F(GpuExtremes, Opacities) {
    for (const double x : {-1e30, -50.0, -5.6, 0.0, 9.0, 17.0, 50.0, 88.0, 1e30})
        check("opacity " + std::to_string(x), [&](auto& s) {
            for (std::int64_t i = 0; i < s.count; i += 3) set(s, Group::kOpacity, i, {x});
        });
}

TEST_F(GpuExtremes, Rotations) {
    for (const double x : {0.0, 1e-30, 1e-5, 1e-3, 1e10, 1e18, 1e30})
        check("quaternions of length " + std::to_string(x), [&](auto& s) {
            for (std::int64_t i = 0; i < s.count; i += 2)
                for (int k = 0; k < 4; ++k) s[Group::kRotation].param[4 * i + k] *= x;
        });
}

TEST_F(GpuExtremes, PlacesAroundTheCamera) {
    const auto camera = test_camera(kWidth, kHeight);
    for (const double depth : {-1e20, -1.0, -1e-6, 0.0, 1e-30, 1e-6, 0.1999999, 0.2, 0.2000001, 9999.0, 10001.0, 1e20})
        for (const double aside : {0.0, 1.0, 1e4, 1e20})
            check(
                "depth " + std::to_string(depth) + ", " + std::to_string(aside) + " aside",
                [&](auto& s) {
                    for (const std::int64_t i : {1, 8, 30})
                        place(s, i,
                              camera.rotation.transposed_times(Vec3<double>{aside, -0.5 * aside, depth} -
                                                               camera.translation));
                },
                1e-3, 0.02);
    check("on the camera", [&](auto& s) { place(s, 3, camera.position); });
}

TEST_F(GpuExtremes, Colours) {
    for (const double x : {-1e20, -100.0, 100.0, 1e4})
        check(
            "base colour " + std::to_string(x),
            [&](auto& s) {
                set(s, Group::kBase, 4, {x, 0, -x}), s[Group::kResidual].param[45 * 6] = x;
            },
            1e-5 * std::max(1.0, std::abs(x)));
}

TEST_F(GpuExtremes, WhatIsNotANumberStaysWhereItIs) {
    for (const double bad : {double(kNan), double(kInf), -double(kInf)})
        for (int g = 0; g < 4; ++g)  // a colour that is not finite is one on the screen, too
            check(std::string(kGroupNames[g]) + " of " + std::to_string(bad),
                  [&](auto& s) { s.groups[g].param[std::size_t(5 * s.groups[g].width)] = bad; });
}

/// Tries combinations that no case above has, as they may occur before pruning.
TEST_F(GpuExtremes, Combinations) {
    for (const double mean : {0.0, double(kNan), double(kInf), -double(kInf), 1e30})
        for (const double scale : {-30.0, 0.0, 30.0, 60.0, double(kNan)})
            for (const double opacity : {-50.0, 0.0, 50.0, double(kNan)})
                check(std::to_string(mean) + ", " + std::to_string(scale) + ", " + std::to_string(opacity),
                      [&](auto& s) {
                          s[Group::kMean].param[4] = mean;
                          set(s, Group::kScale, 2, {scale, scale, scale});
                          set(s, Group::kOpacity, 2, {opacity});
                          set(s, Group::kRotation, 3, {0, 0, 0, 0});
                      });
}

}  // namespace
}  // namespace gs::test
