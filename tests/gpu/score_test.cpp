// SPDX-License-Identifier: Apache-2.0
// Scores on the device against the CPU's, and the rows that go by them. Skipped where there is no device.
#include "kernels/densify/densify.h"
#include "tests/gpu/scenes.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/lowest_scores.h"

namespace gs::test {
namespace {

class GpuScores : public Gpu {};

std::vector<RenderRequest> views_of(const TestScene& scene) {
    std::vector<RenderRequest> views(3);
    for (RenderRequest& view : views) view.camera = scene.camera, view.background = scene.background;
    views[1].camera = cast<float>(test_camera(47, 31));
    views[2].background = {0, 0, 0};
    return views;
}

/// Expects scores that differ by rounding only. Float exponentials and atomics differ in the last bits, and a fragment
/// may lie on the other side of a threshold. `rounding` is TestScene::rounding_share, what single precision is good for
/// in a scene.
void expect_near(const std::vector<float>& cpu, const std::vector<float>& gpu, double rounding) {
    ASSERT_EQ(cpu.size(), gpu.size());
    const float largest = cpu.empty() ? 0 : *std::max_element(cpu.begin(), cpu.end());
    std::size_t beyond = 0;
    double worst = 0;
    for (std::size_t i = 0; i < cpu.size(); ++i) {
        ASSERT_TRUE(std::isfinite(gpu[i])) << i;
        const double error = std::abs(double(cpu[i]) - gpu[i]), bound = rounding * cpu[i] + 1e-5 * largest;
        beyond += error > bound;
        worst = std::max(worst, largest > 0 ? error / largest : error);
    }
    std::printf("  worst difference %.1e of the largest score %.3g; %zu of %zu beyond their bounds\n", worst,
                double(largest), beyond, cpu.size());
    EXPECT_LE(beyond, cpu.size() / 100);
    EXPECT_LE(worst, std::max(1e-2, rounding));
}

class GpuScoresOf : public GpuScores, public ::testing::WithParamInterface<NamedScene> {};
INSTANTIATE_TEST_SUITE_P(Scenes, GpuScoresOf, ::testing::ValuesIn(test_scenes()), scene_name);

TEST_P(GpuScoresOf, AreThoseOfTheCpu) {
    const TestScene scene = GetParam().make();
    const auto cpu = make_cpu_backend(scene.model.appearance);
    cpu->upload(scene.model);
    const auto expected = cpu->scores(views_of(scene));
    for (const bool deterministic : {false, true}) {
        const auto gpu = make_cuda_backend(scene.model.appearance, {.deterministic = deterministic});
        gpu->upload(scene.model);
        expect_near(expected, gpu->scores(views_of(scene)), scene.rounding_share);
    }
}

TEST_P(GpuScoresOf, PruneTheRowsOfTheCpu) {
    const TestScene scene = GetParam().make();
    for (const double ratio : {0.0, 0.3, 0.8, 1.0}) {
        // Pruning uses the very scores that are asked for when the order is fixed.
        const auto gpu = make_cuda_backend(scene.model.appearance, {.deterministic = true});
        gpu->upload(scene.model);
        Gaussians expected = gpu->download(true);
        const std::int64_t removed = remove_lowest_scores(expected, gpu->scores(views_of(scene)), ratio);
        EXPECT_EQ(gpu->prune_lowest_scores(views_of(scene), ratio), removed) << ratio;
        expect_same_bits(gpu->download(true), expected);
    }
}

TEST_F(GpuScores, RepeatThemselvesWithAFixedOrder) {
    const TestScene scene = random_scene(5000, 3, 640, 480, -1, 5);
    std::vector<float> first;
    for (int k = 0; k < 3; ++k) {
        const auto gpu = make_cuda_backend(scene.model.appearance, {.deterministic = true});
        gpu->upload(scene.model);
        const auto scores = gpu->scores(views_of(scene));
        if (k == 0) first = scores;
        EXPECT_TRUE(same_bits(first, scores));
    }
}

/// The first view of a backend rarely fits (see capacity_test.cpp).
TEST_F(GpuScores, OfViewsThatDoNotFitAreWhole) {
    const TestScene scene = random_scene(3000, 3, 640, 480, -0.5, 5);
    const auto cold = make_cuda_backend(scene.model.appearance, {.deterministic = true}),
               warm = make_cuda_backend(scene.model.appearance, {.deterministic = true});
    cold->upload(scene.model), warm->upload(scene.model);
    RenderedImage image;
    warm->render(views_of(scene)[0], image);
    EXPECT_TRUE(same_bits(cold->scores(views_of(scene)), warm->scores(views_of(scene))));
}

TEST_F(GpuScores, OfNothingAreZero) {
    const TestScene scene = random_scene(200, 3, 33, 25, -1, 6);
    const auto gpu = make_cuda_backend(scene.model.appearance);
    gpu->upload(scene.model);
    EXPECT_EQ(gpu->scores({}), std::vector<float>(200, 0.0f));
    EXPECT_EQ(gpu->prune_lowest_scores({}, 0.3), 198) << "a hundredth stays";
    EXPECT_EQ(gpu->count(), 2);
}

TEST_F(GpuScores, OfBrokenColoursAreFinite) {
    for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity(), 1e30f}) {
        TestScene scene = random_scene(60, 3, 33, 25, 0, 7);
        scene.model[Group::kBase].param[0] = bad;
        const auto gpu = make_cuda_backend(scene.model.appearance);
        gpu->upload(scene.model);
        expect_finite(gpu->scores(views_of(scene)), "score");
    }
}

/// Steps in flight are done first, residuals catch up, and training goes on with the rows that are left.
TEST_F(GpuScores, ArePrunedByBetweenSteps) {
    const TestScene scene = random_scene(2000, 3, 160, 120, -1, 8);
    const auto gpu = make_cuda_backend(scene.model.appearance, {.deterministic = true}),
               waiting = make_cuda_backend(scene.model.appearance, {.deterministic = true});
    const RandomTarget target(160, 120, 3);
    for (Backend* backend : {gpu.get(), waiting.get()}) {
        backend->upload(scene.model);
        for (int k = 0; k < 8; ++k) {
            if (k == 5) {
                if (backend == waiting.get()) backend->download(true);
                EXPECT_GE(backend->prune_lowest_scores(views_of(scene), 0.8), 1600);
            }
            StepRequest r = step_request(scene.camera, target.image());
            r.iteration = k;
            backend->step(r);
        }
        backend->synchronize();
    }
    expect_same_bits(gpu->download(true), waiting->download(true));
    expect_finite(gpu->download(false)[Group::kMean].param, "mean");
}

}  // namespace
}  // namespace gs::test
