// SPDX-License-Identifier: Apache-2.0
// Residuals of Gaussians out of view take their steps late on the device; the CPU backend takes them one by one.
#include <gtest/gtest.h>

#include "kernels/cuda/cuda_device.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

TEST(LazyAdam, MissedStepsEqualPlainAdam) {
    if (!cuda_available()) GTEST_SKIP() << "no CUDA device: " << cuda_unavailable_reason();
    constexpr int kWidth = 96, kHeight = 72;
    const Gaussians start = cast<float>(random_gaussians(3000, 3, 21));
    const auto cpu = make_cpu_backend(start.appearance), gpu = make_cuda_backend(start.appearance);
    std::vector<std::uint8_t> target(3 * kWidth * kHeight);
    std::mt19937 rng(5);
    for (auto& x : target) x = std::uint8_t(rng());
    StepRequest wide, narrow;
    wide.camera = narrow.camera = cast<float>(test_camera(kWidth, kHeight));
    narrow.camera.fx *= 6, narrow.camera.fy *= 6;  // sees a part of the Gaussians
    for (StepRequest* r : {&wide, &narrow}) {
        r->target = {kWidth, kHeight, 3, target.data(), nullptr, nullptr};
        r->gather_gradient_stats = true;
        r->opacity_reg = r->scale_reg = 0;
        for (double& rate : r->rates) rate = 1e-6;
        r->rates[int(Group::kResidual)] = 1e-3;
    }
    // Moments from the CPU, the same for both: gradients near zero have no sign that two roundings agree about.
    cpu->upload(start);
    for (int k = 0; k < 3; ++k) cpu->step(wide);
    Gaussians state = cpu->download(true);
    state.gradient_sum.assign(state.count, 0.0f), state.gradient_count.assign(state.count, 0.0f);
    for (const int steps : {1, 7, 100, 300}) {  // 300: more than a residual may lag behind
        cpu->upload(state), gpu->upload(state);
        for (int k = 0; k < steps; ++k) {
            StepRequest r = narrow;
            r.rates[int(Group::kResidual)] = 1e-3 * (1 + 0.5 * (k % 5));  // the rate may change from step to step
            cpu->step(r), gpu->step(r);
        }
        const Gaussians a = cpu->download(true), b = gpu->download(true);
        const auto &x = a[Group::kResidual], &y = b[Group::kResidual], &before = state[Group::kResidual];
        std::int64_t unseen = 0;
        double moved = 0, worst = 0, worst_near_epsilon = 0, worst_m = 0, worst_v = 0, scale_m = 0, scale_v = 0;
        for (std::int64_t i = 0; i < a.count; ++i) {
            if (a.gradient_count[i] > 0 || b.gradient_count[i] > 0) continue;
            ++unseen;
            for (std::size_t k = std::size_t(i) * x.width; k < std::size_t(i + 1) * x.width; ++k) {
                moved = std::max(moved, double(std::abs(x.param[k] - before.param[k])));
                // Gradients below 1e-11 come near Adam's epsilon, which the closed form takes as constant.
                double& difference = before.v[k] > 1e-25f ? worst : worst_near_epsilon;
                difference = std::max(difference, double(std::abs(x.param[k] - y.param[k])));
                worst_m = std::max(worst_m, double(std::abs(x.m[k] - y.m[k]))),
                scale_m = std::max(scale_m, double(std::abs(x.m[k])));
                worst_v = std::max(worst_v, double(std::abs(x.v[k] - y.v[k]))),
                scale_v = std::max(scale_v, double(std::abs(x.v[k])));
            }
        }
        std::printf(
            "%d steps: %lld of %lld unseen, moved by up to %.2e, worst difference %.2e (near epsilon %.2e), of m %.2e "
            "of %.2e, of v %.2e of %.2e\n",
            steps, (long long)unseen, (long long)a.count, moved, worst, worst_near_epsilon, worst_m, scale_m, worst_v,
            scale_v);
        EXPECT_GT(unseen, a.count / 10);
        EXPECT_GT(moved, 1e-4);
        // Plain Adam rounds p once a step, by up to half an ulp of p (|p| < 4: 1.2e-7 a step).
        EXPECT_LE(worst, 2e-6 + 1.2e-7 * std::min(steps, 150));
        EXPECT_LE(worst_near_epsilon, 0.05 * moved);
        EXPECT_LE(worst_m, 1e-5 * scale_m + 1e-30);
        EXPECT_LE(worst_v, 1e-4 * scale_v + 1e-30);
    }
}

}  // namespace
}  // namespace gs::test
