// SPDX-License-Identifier: Apache-2.0
// Scores of Speedy-Splat's pruning against finite differences of the image, and which rows go by them.
#include <gtest/gtest.h>

#include <limits>

#include "kernels/base/parallel.h"
#include "kernels/densify/densify.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/lowest_scores.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

constexpr int kWidth = 33, kHeight = 25;  // no whole number of tiles
const Vec3<double> kBackground{0.2, 0.7, 0.4};

/// The sum over pixels of (dI/dG)^2, each by a central difference of the image at that pixel.
std::vector<double> brute_force_scores(const GaussianState<double>& s, const CameraParams<double>& camera,
                                       const Vec3<double>& background) {
    constexpr double kStep = 1e-8;  // I is linear in G; small, so that no alpha crosses 1/255
    const BruteForce reference(s, camera);
    std::vector<double> scores(s.count, 0.0);
    const auto sum = [&](int x, int y, Bump bump) {
        const Vec3<double> c = reference.pixel(x, y, background, true, bump).color;
        return c.x + c.y + c.z;
    };
    for (std::int64_t i = 0; i < s.count; ++i)
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x) {
                const double slope = (sum(x, y, {i, kStep}) - sum(x, y, {i, -kStep})) / (2 * kStep);
                scores[i] += slope * slope;
            }
    return scores;
}

std::vector<double> double_scores(const GaussianState<double>& s, const CameraParams<double>& camera,
                                  const Vec3<double>& background) {
    Pipeline<double, appearance::Sh> pipe;
    pipe.render(s, camera, background);
    std::vector<double> scores(s.count, 0.0);
    pipe.raster.add_scores(pipe.image.data(), pipe.transmittance.data(), scores);
    return scores;
}

Gaussians float_scene(std::int64_t n, std::uint32_t seed) {
    Gaussians s = cast<float>(random_gaussians(n, 3, seed));
    s.appearance.model = "sh";
    return s;
}

RenderRequest view(int width, int height) {
    RenderRequest r;
    r.camera = cast<float>(test_camera(width, height));
    r.background = {0.2f, 0.7f, 0.4f};
    return r;
}

std::vector<float> cpu_scores(const Gaussians& s, const std::vector<RenderRequest>& views) {
    const auto backend = make_cpu_backend(s.appearance);
    backend->upload(s);
    return backend->scores(views);
}

TEST(Scores, AreTheSquaredSlopesOfTheImage) {
    const auto camera = test_camera(kWidth, kHeight);
    for (std::uint32_t seed = 1; seed <= 4; ++seed) {
        auto s = random_gaussians(24, 3, seed);
        if (seed == 4)  // opaque: pixels are finished, and 1 - alpha is close to nothing
            for (double& x : s[Group::kOpacity].param) x = 6 + x;
        const auto expected = brute_force_scores(s, camera, kBackground),
                   scores = double_scores(s, camera, kBackground);
        const double largest = *std::max_element(expected.begin(), expected.end());
        ASSERT_GT(largest, 1);
        double worst = 0;
        for (std::int64_t i = 0; i < s.count; ++i) worst = std::max(worst, std::abs(scores[i] - expected[i]) / largest);
        EXPECT_LT(worst, 1e-7) << "seed " << seed;
        std::printf("seed %u: worst error %.1e of the largest score %.3g\n", seed, worst, largest);
    }
}

TEST(Scores, OfFloatsFollowThoseOfDoubles) {
    const Gaussians s = float_scene(200, 7);
    const auto scores = cpu_scores(s, {view(kWidth, kHeight)});
    const auto expected = double_scores(cast<double>(s), test_camera(kWidth, kHeight), kBackground);
    const double largest = *std::max_element(expected.begin(), expected.end());
    for (std::int64_t i = 0; i < s.count; ++i)
        EXPECT_NEAR(scores[i], expected[i], 1e-3 * expected[i] + 1e-5 * largest) << i;
}

TEST(Scores, OfViewsAddUp) {
    const Gaussians s = float_scene(50, 8);
    const RenderRequest a = view(kWidth, kHeight), b = view(20, 40);
    const auto sa = cpu_scores(s, {a}), sb = cpu_scores(s, {b}), both = cpu_scores(s, {a, b});
    for (std::int64_t i = 0; i < s.count; ++i) EXPECT_FLOAT_EQ(both[i], sa[i] + sb[i]);
    EXPECT_EQ(cpu_scores(s, {}), std::vector<float>(50, 0.0f)) << "no view: nobody is seen";
}

TEST(Scores, DoNotDependOnTheNumberOfThreads) {
    const Gaussians s = float_scene(3000, 9);
    const std::vector<RenderRequest> views = {view(160, 120), view(61, 77)};
    set_num_threads(1);
    const auto one = cpu_scores(s, views);
    for (const int threads : {2, 3, 8}) {
        set_num_threads(threads);
        EXPECT_EQ(cpu_scores(s, views), one) << threads;
    }
    set_num_threads(0);
}

TEST(Scores, ExtremesAreZeroOrFinite) {
    EXPECT_TRUE(cpu_scores(float_scene(0, 1), {view(kWidth, kHeight)}).empty());
    Gaussians s = float_scene(40, 10);
    for (float x : cpu_scores(s, {view(1, 1)})) EXPECT_TRUE(std::isfinite(x));
    Gaussians hidden = s;  // behind the camera
    for (std::int64_t i = 0; i < s.count; ++i)
        std::fill_n(&hidden[Group::kMean].param[3 * i], 3, 1e5f * (i % 2 ? 1.0f : -1.0f));
    RenderRequest narrow = view(kWidth, kHeight);
    narrow.camera.far_plane = 100;
    EXPECT_EQ(cpu_scores(hidden, {narrow}), std::vector<float>(40, 0.0f));
    for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity(), 1e30f}) {
        Gaussians broken = s;
        broken[Group::kBase].param[0] = bad;
        for (float x : cpu_scores(broken, {view(kWidth, kHeight)})) EXPECT_TRUE(std::isfinite(x)) << bad;
    }
}

/// Returns rows whose values tell their number.
Gaussians rows(std::int64_t n) {
    Gaussians s = float_scene(n, 3);
    for (std::int64_t i = 0; i < n; ++i) s[Group::kMean].param[3 * i] = float(i);
    for (auto& group : s.groups) group.m = group.v = group.param;
    s.gradient_sum.assign(n, 1.0f), s.gradient_count.assign(n, 1.0f);
    return s;
}

std::vector<int> kept_rows(const std::vector<float>& scores, double ratio) {
    Gaussians s = rows(std::int64_t(scores.size()));
    const std::int64_t before = s.count, removed = remove_lowest_scores(s, scores, ratio);
    EXPECT_EQ(removed, before - s.count);
    std::vector<int> kept;
    for (std::int64_t i = 0; i < s.count; ++i) {
        kept.push_back(int(s[Group::kMean].param[3 * i]));
        EXPECT_EQ(s[Group::kMean].m[3 * i], float(kept.back())) << "moments move along";
    }
    EXPECT_EQ(s.gradient_sum.size(), std::size_t(s.count));
    EXPECT_EQ(s[Group::kResidual].param.size(), std::size_t(45 * s.count));
    return kept;
}

TEST(ScoreRule, RankIsTheOneOfTheSpec) {
    EXPECT_EQ(score_rank(0.8, 11), 9);  // floor(0.8 * 10) + 1
    EXPECT_EQ(score_rank(0.3, 5), 2);
    EXPECT_EQ(score_rank(0.8, 1), 1);
    EXPECT_EQ(score_rank(0, 7), 1);
    EXPECT_EQ(score_rank(1, 7), 7);
    EXPECT_EQ(least_kept(1), 1);
    EXPECT_EQ(least_kept(100), 1);
    EXPECT_EQ(least_kept(101), 2);
}

TEST(ScoreRule, TheLowestGoAndTheRestKeepsItsOrder) {
    EXPECT_EQ(kept_rows({5, 1, 4, 2, 3}, 0.3), (std::vector<int>{0, 2, 4}));
    EXPECT_EQ(kept_rows({5, 1, 4, 2, 3}, 0.8), (std::vector<int>{0}));
}

TEST(ScoreRule, WhatScoresLikeTheThresholdGoesToo) {
    EXPECT_EQ(kept_rows({7, 2, 9, 2, 2, 2, 8, 1}, 0.3), (std::vector<int>{0, 2, 6}));
    EXPECT_EQ(kept_rows({0, 3, 0, 0, 0, 0, 2, 0}, 0.1), (std::vector<int>{1, 6}))
        << "the never seen go whatever the ratio";
}

TEST(ScoreRule, AHundredthStays) {
    std::vector<int> first(3);
    std::iota(first.begin(), first.end(), 0);
    EXPECT_EQ(kept_rows(std::vector<float>(250, 0.0f), 0.3), first) << "all equal";
    std::vector<float> scores(250, 1.0f);
    scores[200] = 5;
    EXPECT_EQ(kept_rows(scores, 0.8), (std::vector<int>{0, 1, 200})) << "the best stays, then the first of the equal";
    EXPECT_EQ(kept_rows({4}, 0.8), (std::vector<int>{0}));
    EXPECT_TRUE(kept_rows({}, 0.8).empty());
}

TEST(ScoreRule, TheBackendPrunesByTheScoresOfItsViews) {
    Gaussians s = float_scene(300, 11);
    const std::vector<RenderRequest> views = {view(kWidth, kHeight), view(40, 20)};
    const auto backend = make_cpu_backend(s.appearance);
    backend->upload(s);
    Gaussians expected = backend->download(true);
    const std::int64_t removed = remove_lowest_scores(expected, backend->scores(views), 0.8);
    EXPECT_EQ(backend->prune_lowest_scores(views, 0.8), removed);
    EXPECT_GE(removed, 240);
    const Gaussians after = backend->download(true);
    EXPECT_EQ(after.count, expected.count);
    for (int g = 0; g < kNumGroups; ++g) EXPECT_EQ(after.groups[g].param, expected.groups[g].param);
}

}  // namespace
}  // namespace gs::test
