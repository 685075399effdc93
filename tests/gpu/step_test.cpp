// SPDX-License-Identifier: Apache-2.0
// One optimizer step of the CUDA backend against the reference in double: loss, every gradient as moments, parameters,
// statistic. Skipped where there is no device.
#include <gtest/gtest.h>

#include "kernels/cuda/cuda_device.h"
#include "tests/gpu/agreement.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

class GpuStep : public ::testing::TestWithParam<NamedScene> {
  protected:
    void SetUp() override { skip_without_device(); }
};
INSTANTIATE_TEST_SUITE_P(Scenes, GpuStep, ::testing::ValuesIn(test_scenes()), scene_name);

TEST_P(GpuStep, LiesWithinItsErrorBounds) {
    const TestScene scene = GetParam().make();
    const auto fast = make_cuda_backend(scene.model.appearance),
               fixed_order = make_cuda_backend(scene.model.appearance, {.deterministic = true});
    expect_step_within_bounds({fast.get(), fixed_order.get()}, scene);
}

class GpuSteps : public Gpu {};

TEST_F(GpuSteps, WithoutAnythingInFrontMoveNothing) {
    const TestScene scene = behind_scene();
    const RandomTarget target(50, 40, 3);
    StepRequest r = step_request(scene.camera, target.image());
    r.loss.opacity_reg = r.loss.scale_reg = 0;
    const auto gpu = make_cuda_backend(scene.model.appearance);
    gpu->upload(scene.model);
    gpu->step(r);
    const Gaussians after = gpu->download(true);
    for (int g = 0; g < kNumGroups; ++g) {
        EXPECT_EQ(after.groups[g].param, scene.model.groups[g].param);
        EXPECT_EQ(after.groups[g].m, std::vector<float>(after.groups[g].m.size()));
    }
    EXPECT_EQ(after.gradient_count, std::vector<float>(std::size_t(after.count)));
}

TEST_F(GpuSteps, UnderAMaskOfZerosOnlyRegularise) {
    const TestScene scene = random_scene(200, 3, 64, 48, -0.5, 7);
    RandomTarget target(64, 48, 3, true);
    std::fill(target.mask.begin(), target.mask.end(), std::uint8_t(0));
    const auto gpu = make_cuda_backend(scene.model.appearance);
    gpu->upload(scene.model);
    gpu->step(step_request(scene.camera, target.image()));
    gpu->synchronize();
    EXPECT_EQ(gpu->take_stats().loss, 0);
    const Gaussians after = gpu->download(true);
    for (const Group g : {Group::kMean, Group::kRotation, Group::kBase, Group::kResidual})
        EXPECT_EQ(after[g].param, scene.model[g].param) << kGroupNames[int(g)];
    for (const float m : after[Group::kScale].m) EXPECT_GT(m, 0);
    for (const float m : after[Group::kOpacity].m) EXPECT_GT(m, 0);
}

TEST_F(GpuSteps, OnTheirOwnPictureHaveNothingToLearn) {
    for (const std::int64_t rows : {40, 4000}) {  // with plain background in it, and without
        const TestScene scene = random_scene(rows, 3, 150, 70, -1.0, 9);
        const auto gpu = make_cuda_backend(scene.model.appearance);
        gpu->upload(scene.model);
        StepRequest r = step_request(scene.camera, {});
        r.loss.opacity_reg = r.loss.scale_reg = 0;
        RenderRequest view;
        view.camera = scene.camera, view.background = r.background;
        RenderedImage image;
        gpu->render(view, image);
        std::vector<float> pixels;
        const std::size_t plane = image.rgb.size() / 3;
        for (std::size_t i = 0; i < plane; ++i)
            for (std::size_t c = 0; c < 3; ++c) pixels.push_back(image.rgb[c * plane + i]);
        r.target = {image.width, image.height, 3, nullptr, pixels.data(), nullptr, {}};
        gpu->step(r);
        gpu->synchronize();
        const StepStats stats = gpu->take_stats();
        EXPECT_EQ(stats.l1, 0);
        EXPECT_EQ(stats.ssim, 1);
        const Gaussians after = gpu->download(true);
        for (const auto& group : after.groups) EXPECT_EQ(group.m, std::vector<float>(group.m.size()));
    }
}

/// Takes five steps on two views with noise, rates per residual column and higher ones for far means. Both sides
/// compute in float, so each may be a few roundings off per step, which Adam turns into parts of a rate where gradients
/// are near zero.
TEST_F(GpuSteps, WithNoiseAndRatesOfTheirOwnFollowTheCpu) {
    const TestScene scene = random_scene(2000, 3, 160, 120, -1.5, 8);
    const auto cpu = make_cpu_backend(scene.model.appearance), gpu = make_cuda_backend(scene.model.appearance);
    cpu->upload(scene.model), gpu->upload(scene.model);
    const RandomTarget targets[] = {{160, 120, 3, false, false, 1}, {160, 120, 4, true, false, 2}};
    for (int k = 0; k < 5; ++k) {
        StepRequest r = step_request(scene.camera, targets[k % 2].image(k % 2));
        r.iteration = k, r.seed = 3, r.rates.noise = 80;
        r.rates.extent = 0.5f, r.rates.far = 0.7f;
        for (int c = 0; c < 45; ++c) r.rates.residuals.push_back(1e-4 * (1 + c));
        cpu->step(r), gpu->step(r);
    }
    const Gaussians a = cpu->download(true), b = gpu->download(true);
    const StepRequest rates = step_request(scene.camera, targets[0].image());
    for (int g = 0; g < kNumGroups; ++g) {
        double sum = 0, squares = 0;
        const auto& before = scene.model.groups[g].param;
        for (std::size_t i = 0; i < before.size(); ++i) {
            const double moved = double(a.groups[g].param[i]) - before[i],
                         difference = double(a.groups[g].param[i]) - b.groups[g].param[i];
            ASSERT_TRUE(std::isfinite(b.groups[g].param[i]));
            sum += difference * difference, squares += moved * moved;
        }
        std::printf("  %-14s difference after five steps: %.1e of the way\n", kGroupNames[g], std::sqrt(sum / squares));
        EXPECT_LE(std::sqrt(sum), 0.05 * std::sqrt(squares))
            << kGroupNames[g];  // parameters moved by an ulp give up to 7e-3
    }
}

/// The CPU in float is the measure, as for images. The root mean square tells about all Gaussians but those whose order
/// rounding swapped.
TEST_F(GpuSteps, OfAMillionGaussiansHaveTheGradientsOfTheCpu) {
    auto s = random_gaussians(1000000, 0, 22);
    for (double& x : s[Group::kScale].param) x -= 3.5;
    const Gaussians model = float_model(s);
    const RandomTarget target(640, 480, 3);
    const StepRequest r = step_request(cast<float>(test_camera(640, 480)), target.image());
    Gaussians after[2];
    for (int k = 0; k < 2; ++k) {
        const auto backend = k ? make_cuda_backend(model.appearance) : make_cpu_backend(model.appearance);
        backend->upload(model);
        backend->step(r);
        after[k] = backend->download(true);
    }
    for (int g = 0; g < kNumGroups; ++g) {
        double sum = 0, squares = 0;
        for (std::size_t i = 0; i < after[0].groups[g].m.size(); ++i) {
            const double a = after[0].groups[g].m[i], b = after[1].groups[g].m[i];
            ASSERT_TRUE(std::isfinite(b));
            sum += (a - b) * (a - b), squares += a * a;
        }
        if (squares == 0) continue;
        std::printf("  %-14s relative difference %.1e\n", kGroupNames[g], std::sqrt(sum / squares));
        EXPECT_LE(std::sqrt(sum), 5e-3 * std::sqrt(squares))  // parameters moved by an ulp give up to 4e-4
            << kGroupNames[g];
    }
}

// Residuals of Gaussians out of view take their steps late on the device; the CPU backend takes them one by one.

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
        r->target = {kWidth, kHeight, 3, target.data(), nullptr, nullptr, {}};
        r->gather_gradient_stats = true;
        r->loss.opacity_reg = r->loss.scale_reg = 0;
        for (double& rate : r->rates.groups) rate = 1e-6;
        r->rates.groups[int(Group::kResidual)] = 1e-3;
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
            r.rates.groups[int(Group::kResidual)] =
                1e-3 * (1 + 0.5 * (k % 5));  // the rate may change from step to step
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
