// SPDX-License-Identifier: Apache-2.0
// What the GPU tests share: skipping without a device, targets, requests, equality of models.
#pragma once

#include <gtest/gtest.h>

#include <cstring>

#include "kernels/cuda/cuda_device.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {

inline void skip_without_device() {
    if (!cuda_available()) GTEST_SKIP() << "no CUDA device: " << cuda_unavailable_reason();
}

class Gpu : public ::testing::Test {
  protected:
    void SetUp() override { skip_without_device(); }
};

/// Random pixels, in every form a target comes in.
struct RandomTarget {
    int width, height, channels;
    std::vector<std::uint8_t> u8, mask;
    std::vector<float> f32;

    RandomTarget(int w, int h, int c, bool masked = false, bool floats = false, std::uint32_t seed = 5)
        : width(w), height(h), channels(c) {
        std::mt19937 rng(seed);
        const std::size_t pixels = std::size_t(w) * h;
        if (floats) {
            f32.resize(pixels * c);
            for (float& x : f32) x = float(rng() % 65536) / 65535.0f;
        } else {
            u8.resize(pixels * c);
            for (auto& x : u8) x = std::uint8_t(rng());
        }
        if (masked) mask.resize(pixels);
        for (auto& x : mask) x = rng() % 4 ? std::uint8_t(rng()) : 0;
    }
    /// Makes the pixels of column x and all right of it transparent. Four channels.
    void clear_from(int x) {
        for (std::size_t i = 0; i < std::size_t(width) * height; ++i)
            if (int(i % std::size_t(width)) >= x) (u8.empty() ? void(f32[4 * i + 3] = 0) : void(u8[4 * i + 3] = 0));
    }
    TargetImage image(int view = -1) const {
        return {width,
                height,
                channels,
                u8.empty() ? nullptr : u8.data(),
                f32.empty() ? nullptr : f32.data(),
                mask.empty() ? nullptr : mask.data(),
                {view}};
    }
};

/// Returns a step with rates, regularisers and statistic.
inline StepRequest step_request(const CameraParams<float>& camera, const TargetImage& target) {
    StepRequest r;
    r.camera = camera;
    r.background = {0.3f, 0.6f, 0.1f};
    r.target = target;
    r.gather_gradient_stats = true;
    const double rates[kNumGroups] = {1.6e-4, 5e-3, 1e-3, 5e-2, 2.5e-3, 1.25e-4};
    std::copy_n(rates, kNumGroups, r.rates.groups);
    return r;
}

/// Returns the scene in float, with the model `none` where the appearance has no degree.
inline Gaussians float_model(const GaussianState<double>& s) {
    Gaussians f = cast<float>(s);
    if (f.appearance.max_degree == 0) f.appearance.model = "none";
    return f;
}

inline bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0);
}

/// Expects equal bits of parameters and moments.
inline void expect_same_bits(const Gaussians& a, const Gaussians& b) {
    ASSERT_EQ(a.count, b.count);
    EXPECT_EQ(a.step, b.step);
    for (int g = 0; g < kNumGroups; ++g) {
        EXPECT_TRUE(same_bits(a.groups[g].param, b.groups[g].param)) << kGroupNames[g];
        EXPECT_TRUE(same_bits(a.groups[g].m, b.groups[g].m)) << "moments m of " << kGroupNames[g];
        EXPECT_TRUE(same_bits(a.groups[g].v, b.groups[g].v)) << "moments v of " << kGroupNames[g];
    }
    EXPECT_TRUE(same_bits(a.gradient_sum, b.gradient_sum));
    EXPECT_TRUE(same_bits(a.gradient_count, b.gradient_count));
    EXPECT_TRUE(same_bits(a.last_step, b.last_step));
}

inline void expect_finite(const std::vector<float>& values, const char* what) {
    for (std::size_t i = 0; i < values.size(); ++i) ASSERT_TRUE(std::isfinite(values[i])) << what << " " << i;
}

}  // namespace gs::test
