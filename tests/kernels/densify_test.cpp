// SPDX-License-Identifier: Apache-2.0
// Relocation formula, MCMC and ADC densification, Morton order, pruning.
#include <gtest/gtest.h>

#include <numeric>
#include <set>

#include "kernels/base/error.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/mcmc_device.h"
#include "kernels/optimizer/update_device.h"

namespace gs {
namespace {

/// Returns rows that can be recognised: every value of row i is i + a fraction of its group.
Gaussians numbered(std::int64_t n) {
    Gaussians s;
    s.count = n;
    const int widths[kNumGroups] = {3, 3, 4, 1, 3, 9};
    for (int g = 0; g < kNumGroups; ++g) {
        auto& group = s.groups[g];
        group.width = widths[g];
        group.param.resize(n * widths[g]);
        for (std::int64_t i = 0; i < n; ++i)
            for (int k = 0; k < widths[g]; ++k) group.param[i * widths[g] + k] = float(i) + 0.01f * float(k + 10 * g);
        group.m.assign(group.param.size(), 1.0f);
        group.v.assign(group.param.size(), 2.0f);
    }
    for (float& x : s[Group::kScale].param) x = -3;
    for (float& x : s[Group::kOpacity].param) x = 0;
    return s;
}

TEST(Relocation, MatchesTheDoubleSumOfThePaper) {
    for (const double o : {0.005, 0.1, 0.5, 0.9, 0.99999}) {
        for (const int n : {1, 2, 5, 20, 50}) {
            const double shared = 1 - std::pow(1 - o, 1.0 / n);
            double sum = 0;
            for (int i = 1; i <= n; ++i)
                for (int k = 0; k < i; ++k)
                    sum += std::tgamma(i) / (std::tgamma(k + 1) * std::tgamma(i - k)) * (k % 2 ? -1 : 1) /
                           std::sqrt(k + 1.0) * std::pow(shared, k + 1);
            const Relocated r = relocate(o, n);
            EXPECT_NEAR(r.opacity, shared, 1e-12);
            EXPECT_NEAR(r.scale_factor, o / sum, 1e-8 * o / sum) << "o " << o << " n " << n;
        }
    }
    EXPECT_NEAR(relocate(0.3, 1).scale_factor, 1, 1e-12);
    EXPECT_GT(relocate(1.0, 50).scale_factor, 0.5);  // 1/1.9814: the clamped limit, no cancellation
    EXPECT_LT(relocate(1.0, 50).opacity, 0.28);
    EXPECT_EQ(relocate(0.5, 500).opacity, relocate(0.5, 50).opacity);
}

TEST(Mcmc, WeightsAreIntegersThatSumExactly) {
    const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
    EXPECT_EQ(sampling_weight(0), std::uint64_t(1) << 31);
    EXPECT_EQ(sampling_weight(inf), std::uint64_t(1) << 32);
    EXPECT_EQ(sampling_weight(-inf), 0u);
    EXPECT_EQ(sampling_weight(nan), 0u);
    EXPECT_EQ(sampling_weight(-40), 0u);
    EXPECT_NEAR(double(sampling_weight(-5)) / 4294967296.0, sigmoid(-5.0), 1.2e-10);
}

TEST(Mcmc, WeightsByGradientAreOpacityTimesItsRoot) {
    const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
    const float squares[] = {4e-8f, 9e-8f, 3e-8f};  // of gradients of 2e-4, 3e-4, 1.7e-4
    EXPECT_NEAR(double(gradient_weight(0, squares, 0)) / 4294967296.0, 0.5 * 0.02, 1e-9);
    const double aged = double(gradient_weight(0, squares, 700)) / 4294967296.0;
    EXPECT_NEAR(aged, 0.5 * 0.02 * std::pow(0.999, 700 / 4.0), 1e-9) << "the moment as it would be now";
    EXPECT_EQ(gradient_weight(0, squares, 1e9), 0u);
    for (const float bad : {nan, -1.0f}) {
        const float second_moment[] = {1, 2, bad * 5};
        EXPECT_EQ(gradient_weight(0, second_moment, 0), 0u);
    }
    const float none[] = {0, 0, 0}, large[] = {inf, 0, 0};
    EXPECT_EQ(gradient_weight(10, none, 0), 0u);
    EXPECT_EQ(gradient_weight(10, large, 0), std::uint64_t(1) << 32);
    EXPECT_EQ(gradient_weight(nan, squares, 0), 0u);
    EXPECT_EQ(gradient_weight(-inf, squares, 0), 0u);
}

TEST(Mcmc, GrowthByGradientCopiesWhatTheLossPullsAt) {
    Gaussians s = numbered(100);
    for (int i = 0; i < 100; ++i) s[Group::kRotation].param[4 * i] = 1, s.last_step.push_back(float(i));
    const Gaussians before = s;
    std::fill(s[Group::kBase].v.begin(), s[Group::kBase].v.end(), 0.0f);
    for (int i = 40; i < 50; ++i) s[Group::kBase].v[3 * i] = 1e-8f;
    McmcParams p;
    p.growth = 1.3, p.by_gradient = true;
    ASSERT_EQ(mcmc_densify(s, p, 600, 1).added, 30);
    for (int i = 100; i < 130; ++i) {
        const int source = int(std::lround(s[Group::kBase].param[3 * i] - before[Group::kBase].param[0]));
        EXPECT_TRUE(source >= 40 && source < 50) << source;
        EXPECT_EQ(s.last_step[i], float(source));
    }
    std::fill(s[Group::kBase].v.begin(), s[Group::kBase].v.end(), 0.0f);
    EXPECT_EQ(mcmc_densify(s, p, 700, 1).added, 0) << "no gradient, no reason to grow";
}

TEST(Mcmc, DrawsInProportionToTheWeightAndNeverTheWeightless) {
    const std::uint64_t weights[] = {0, 1000, 0, 3000, 6000, 0};
    std::uint64_t sums[6], total = 0;
    for (int i = 0; i < 6; ++i) sums[i] = total += weights[i];
    constexpr int n = 100000;
    double times[6] = {};
    for (int k = 0; k < n; ++k) ++times[draw_row(sums, 6, 1, RngStream::kGrow, 600, std::uint32_t(k))];
    for (int i = 0; i < 6; ++i)
        EXPECT_NEAR(times[i] / n, double(weights[i]) / double(total), weights[i] ? 0.005 : 0) << i;
    // One row, and sums of any size: the product with the random number takes 128 bits.
    for (const std::uint64_t sum : {std::uint64_t(1), ~std::uint64_t(0)})
        for (std::uint32_t k = 0; k < 100; ++k) EXPECT_EQ(draw_row(&sum, 1, 2, RngStream::kGrow, 0, k), 0u);
    const std::uint64_t halves[] = {~std::uint64_t(0) / 2, ~std::uint64_t(0)};
    int second = 0;
    for (std::uint32_t k = 0; k < 10000; ++k) second += int(draw_row(halves, 2, 3, RngStream::kGrow, 0, k));
    EXPECT_NEAR(second, 5000, 250);
}

TEST(Mcmc, TargetIsFivePercentMoreUpToTheCap) {
    McmcParams p;
    p.cap = 1000;
    EXPECT_EQ(mcmc_target(0, p), 1);
    EXPECT_EQ(mcmc_target(3, p), 4);
    EXPECT_EQ(mcmc_target(100, p), 105);
    EXPECT_EQ(mcmc_target(990, p), 1000);
    EXPECT_EQ(mcmc_target(1200, p), 1200) << "a start above the cap is kept";
}

TEST(Mcmc, DropsTheStatisticOfTheFormerRows) {
    Gaussians s = numbered(50);
    s.gradient_sum.assign(50, 1.0f), s.gradient_count.assign(50, 1.0f);
    mcmc_densify(s, {}, 600, 1);
    EXPECT_TRUE(s.gradient_sum.empty() && s.gradient_count.empty());
}

TEST(Mcmc, DeadMoveOntoTheLivingAndSharesKeepTheOpacity) {
    Gaussians s = numbered(100);
    for (int i = 0; i < 30; ++i) s[Group::kOpacity].param[i] = -8;  // dead
    s[Group::kRotation].param.assign(400, 0.0f);
    for (int i = 0; i < 100; ++i) s[Group::kRotation].param[4 * i] = 1, s.last_step.push_back(float(i));
    const Gaussians before = s;
    McmcParams p;
    p.cap = 100;
    const DensifyStats stats = mcmc_densify(s, p, 600, 1);
    EXPECT_EQ(stats.relocated, 30);
    EXPECT_EQ(stats.added, 0);
    EXPECT_EQ(s.count, 100);
    std::vector<int> copies(100, 0);
    for (int i = 0; i < 30; ++i) {
        const int source = int(std::lround(s[Group::kBase].param[3 * i] - before[Group::kBase].param[0]));
        ASSERT_GE(source, 30);
        ASSERT_LT(source, 100);
        ++copies[source];
        for (int g = 0; g < kNumGroups; ++g)
            for (int k = 0; k < s.groups[g].width; ++k)
                EXPECT_EQ(s.groups[g].param[i * s.groups[g].width + k],
                          s.groups[g].param[source * s.groups[g].width + k])
                    << kGroupNames[g];
        EXPECT_EQ(s[Group::kMean].m[3 * i], 1) << "dead rows keep their moments";
        EXPECT_EQ(s.last_step[i], float(source));
    }
    for (int i = 30; i < 100; ++i) {
        const double o = sigmoid(double(s[Group::kOpacity].param[i]));
        EXPECT_NEAR(1 - std::pow(1 - o, copies[i] + 1), 0.5, 1e-6)
            << "all copies together are as opaque as the one before";
        EXPECT_EQ(s[Group::kMean].m[3 * i], copies[i] ? 0 : 1) << "moments of sources are zeroed";
    }
}

TEST(Mcmc, GrowsByFivePercentUpToTheCap) {
    Gaussians s = numbered(100);
    for (int i = 0; i < 100; ++i) s[Group::kRotation].param[4 * i] = 1;
    McmcParams p;
    p.cap = 108;
    EXPECT_EQ(mcmc_densify(s, p, 600, 1).added, 5);
    EXPECT_EQ(mcmc_densify(s, p, 700, 1).added, 3);
    EXPECT_EQ(mcmc_densify(s, p, 800, 1).added, 0);
    EXPECT_EQ(s.count, 108);
    for (const auto& g : s.groups) {
        EXPECT_EQ(g.param.size(), 108u * g.width);
        EXPECT_EQ(g.m.size(), g.param.size());
        EXPECT_TRUE(g.width == 0 || g.m.back() == 0) << "new rows start without momentum";
    }
    p.cap = 50;  // fewer than there are: nothing is removed
    EXPECT_EQ(mcmc_densify(s, p, 900, 1).count, 108);
    Gaussians few = numbered(3);
    p.cap = 100;
    EXPECT_EQ(mcmc_densify(few, p, 600, 1).added, 1) << "fewer than 20 still grow";
}

TEST(Mcmc, ExtremesAreSkippedNotPropagated) {
    Gaussians none = numbered(0);
    EXPECT_EQ(mcmc_densify(none, {}, 600, 1).count, 0);
    Gaussians dead = numbered(10);
    for (float& x : dead[Group::kOpacity].param) x = -50;
    McmcParams p;
    p.cap = 10;
    EXPECT_EQ(mcmc_densify(dead, p, 600, 1).relocated, 0);
    Gaussians bad = numbered(10);
    bad[Group::kOpacity].param[3] = std::numeric_limits<float>::quiet_NaN();
    bad[Group::kOpacity].param[4] = 50;
    mcmc_densify(bad, p, 600, 1);
    for (float x : bad[Group::kOpacity].param)
        EXPECT_TRUE(std::isfinite(x)) << "the NaN row was dead and got relocated";
    for (float x : bad[Group::kScale].param) EXPECT_TRUE(std::isfinite(x));
}

TEST(Mcmc, IsReproducibleAndSeeded) {
    Gaussians a = numbered(200), b = numbered(200), c = numbered(200);
    McmcParams p;
    mcmc_densify(a, p, 600, 1);
    mcmc_densify(b, p, 600, 1);
    mcmc_densify(c, p, 600, 2);
    EXPECT_EQ(a[Group::kMean].param, b[Group::kMean].param);
    EXPECT_NE(a[Group::kMean].param, c[Group::kMean].param);
}

TEST(Noise, FollowsTheCovarianceAndTheOpacityGate) {
    GaussianGeometry<float> g{{0, 0, 0}, {0, -2, -4}, {1, 0, 0, 0}, -20};
    double xx = 0, yy = 0, zz = 0;
    constexpr int n = 20000;
    for (int i = 0; i < n; ++i) {
        const Vec3<float> d = sgld_noise(g, 0.5f, 1, 2, i);
        xx += d.x * d.x, yy += d.y * d.y, zz += d.z * d.z;
    }
    const double gate = 0.5 / (1 + std::exp(-0.5));  // opacity 0
    EXPECT_NEAR(std::sqrt(xx / n), gate * 1, 0.02 * gate);
    EXPECT_NEAR(std::sqrt(yy / n), gate * std::exp(-4), 0.02 * gate * std::exp(-4))
        << "the covariance itself, not its root";
    EXPECT_NEAR(std::sqrt(zz / n), gate * std::exp(-8), 0.02 * gate * std::exp(-8));
    g.raw_opacity = 3;
    g.mean = {1, 1, 1};
    EXPECT_EQ(sgld_noise(g, 0.5f, 1, 2, 0).x, 0) << "an opaque Gaussian does not move";
    g.raw_opacity = -20, g.rotation = {0, 0, 0, 0};
    EXPECT_EQ(sgld_noise(g, 0.5f, 1, 2, 0).x, 0);
}

/// Fills the statistic as if every Gaussian had been seen once with this gradient.
void gather(Gaussians& s, float gradient) {
    s.gradient_sum.assign(s.count, gradient);
    s.gradient_count.assign(s.count, 1.0f);
}

Gaussians unit_rotations(Gaussians s) {
    std::fill(s[Group::kRotation].param.begin(), s[Group::kRotation].param.end(), 0.0f);
    for (std::int64_t i = 0; i < s.count; ++i) s[Group::kRotation].param[4 * i] = 1;
    return s;
}

TEST(Adc, ClonesTheSmallSplitsTheLargePrunesTheFaint) {
    Gaussians s = unit_rotations(numbered(4));
    gather(s, 0.001f);
    s.gradient_sum[3] = 0;                                              // does not grow
    s[Group::kOpacity].param[2] = -6;                                   // faint: pruned with its clone
    for (int k = 0; k < 3; ++k) s[Group::kScale].param[3 * 1 + k] = 0;  // large: split
    s.last_step = {40, 41, 42, 43};
    AdcParams p;
    p.extent = 10;  // dense = 0.1, log -2.3
    const DensifyStats d = adc_densify(s, p, 600, 1);
    EXPECT_EQ(d.cloned, 2);
    EXPECT_EQ(d.split, 1);
    EXPECT_EQ(d.pruned, 2);
    EXPECT_EQ(s.count, 5);  // 0, 3, clone of 0, two children of 1
    EXPECT_EQ(s[Group::kBase].param[3 * 2], s[Group::kBase].param[0]) << "clone";
    EXPECT_EQ(s[Group::kMean].param[3 * 2], s[Group::kMean].param[0]) << "a clone does not move";
    EXPECT_EQ(s[Group::kMean].m[3 * 2], 0);
    EXPECT_EQ(s[Group::kMean].m[0], 1) << "the original keeps its moments";
    for (int child : {3, 4}) {
        EXPECT_NEAR(s[Group::kScale].param[3 * child], -std::log(1.6f), 1e-6);
        EXPECT_NE(s[Group::kMean].param[3 * child], numbered(4)[Group::kMean].param[3]);
        EXPECT_FLOAT_EQ(s[Group::kBase].param[3 * child], numbered(4)[Group::kBase].param[3]);
    }
    EXPECT_TRUE(s.gradient_sum.empty()) << "the statistic starts anew";
    EXPECT_EQ(s.last_step, (std::vector<float>{40, 43, 40, 41, 41}));
}

TEST(Adc, StopsAtTheCapWithTheStrongestGradients) {
    Gaussians s = unit_rotations(numbered(10));
    gather(s, 0.001f);
    s.gradient_sum[7] = 0.9f;
    AdcParams p;
    p.extent = 100;
    p.cap = 11;
    EXPECT_EQ(adc_densify(s, p, 600, 1).cloned, 1);
    EXPECT_EQ(s[Group::kBase].param[30], s[Group::kBase].param[21]);
}

TEST(Adc, PrunesTheLargeOnlyWhenAsked) {
    for (bool large : {false, true}) {
        Gaussians s = unit_rotations(numbered(3));
        s[Group::kScale].param[0] = 5;
        AdcParams p;
        p.prune_large = large;
        EXPECT_EQ(adc_densify(s, p, 3100, 1).count, large ? 2 : 3);
    }
}

TEST(Adc, EmptyModelIsAnError) {
    Gaussians s = unit_rotations(numbered(3));
    for (float& x : s[Group::kOpacity].param) x = -9;
    EXPECT_THROW(adc_densify(s, {}, 600, 1), UsageError);
}

TEST(Adc, OpacityResetCapsAtOnePercent) {
    Gaussians s = numbered(3);
    s[Group::kOpacity].param = {2, -1, -7};
    adc_reset_opacity(s);
    EXPECT_NEAR(sigmoid(s[Group::kOpacity].param[0]), 0.01f, 1e-7);
    EXPECT_FLOAT_EQ(s[Group::kOpacity].param[2], -7);
    EXPECT_EQ(s[Group::kOpacity].m[0], 0);
    EXPECT_EQ(s[Group::kMean].m[0], 1);
}

TEST(Rows, MortonOrderIsAPermutationThatKeepsNeighboursTogether) {
    Gaussians s = numbered(512);
    for (int i = 0; i < 512; ++i) {  // a shuffled 8x8x8 grid
        const int j = (i * 197) % 512;
        s[Group::kMean].param[3 * i] = float(j % 8), s[Group::kMean].param[3 * i + 1] = float(j / 8 % 8),
                                  s[Group::kMean].param[3 * i + 2] = float(j / 64);
    }
    const auto order = morton_order(s);
    EXPECT_EQ(std::set<std::uint32_t>(order.begin(), order.end()).size(), 512u);
    s.gradient_sum.resize(512);
    std::iota(s.gradient_sum.begin(), s.gradient_sum.end(), 0.0f);
    const Gaussians before = s;
    gather_rows(s, order);
    for (int i = 0; i < 512; ++i) {
        EXPECT_EQ(s[Group::kBase].param[3 * i], before[Group::kBase].param[3 * order[i]]);
        EXPECT_EQ(s.gradient_sum[i], float(order[i]));
    }
    const float* m = s[Group::kMean].param.data();
    for (int i = 0; i < 512; i += 8)  // every eight in a row fill one 2x2x2 cell
        for (int k = 0; k < 8; ++k)
            for (int c = 0; c < 3; ++c) EXPECT_EQ(int(m[3 * (i + k) + c]) / 2, int(m[3 * i + c]) / 2);
}

TEST(Rows, MortonOrderTakesAnyMean) {
    for (const float x : {std::nanf(""), std::numeric_limits<float>::infinity(),
                          -std::numeric_limits<float>::infinity(), 3e38f, -3e38f}) {
        Gaussians s = numbered(20);
        s[Group::kMean].param[10] = x, s[Group::kMean].param[50] = -x;
        const auto order = morton_order(s);
        EXPECT_EQ(std::set<std::uint32_t>(order.begin(), order.end()).size(), 20u);
    }
    Gaussians same = numbered(20);
    std::fill(same[Group::kMean].param.begin(), same[Group::kMean].param.end(), 2.0f);
    std::vector<std::uint32_t> kept(20);
    std::iota(kept.begin(), kept.end(), 0u);
    EXPECT_EQ(morton_order(same), kept);
    EXPECT_TRUE(morton_order(numbered(0)).empty());
}

TEST(Prune, NonFiniteRowsGoAndAreNamed) {
    Gaussians s = unit_rotations(numbered(5));
    s[Group::kScale].param[4] = std::numeric_limits<float>::infinity();
    s[Group::kBase].param[5] = std::nanf("");
    s[Group::kMean].param[9] = std::nanf("");
    std::int64_t by_group[kNumGroups];
    EXPECT_EQ(remove_nonfinite(s, by_group), 2);
    EXPECT_EQ(s.count, 3);
    EXPECT_EQ(by_group[int(Group::kScale)], 1);
    EXPECT_EQ(by_group[int(Group::kBase)], 1);
    EXPECT_EQ(by_group[int(Group::kMean)], 1);
    EXPECT_EQ(remove_nonfinite(s, by_group), 0);
}

TEST(Prune, RowsThatTrainingCannotHaveMadeGoWithThem) {
    Gaussians s = unit_rotations(numbered(4));
    s[Group::kBase].param[3] = -1e4f;      // row 1
    s[Group::kRotation].param[8] = 1e20f;  // row 2
    s[Group::kScale].param[9] = 900;       // row 3: odd, and kept
    std::int64_t by_group[kNumGroups];
    EXPECT_EQ(remove_nonfinite(s, by_group), 2);
    EXPECT_EQ(by_group[int(Group::kBase)], 1);
    EXPECT_EQ(by_group[int(Group::kRotation)], 1);
    EXPECT_EQ(s.count, 2);
}

TEST(Prune, InvisibleRowsGo) {
    Gaussians s = unit_rotations(numbered(4));
    s[Group::kOpacity].param[1] = -6;  // sigmoid 0.0025 < 1/255
    s[Group::kRotation].param[8] = 0;  // no rotation
    s[Group::kOpacity].param[3] = std::nanf("");
    EXPECT_EQ(remove_invisible(s), 3);
    EXPECT_EQ(s[Group::kBase].param[0], numbered(4)[Group::kBase].param[0]);
}

}  // namespace
}  // namespace gs
