// SPDX-License-Identifier: Apache-2.0
// Densification on the device against the CPU backend: the same rows, in the same order. Skipped where there is no
// device.
#include <gtest/gtest.h>

#include <bit>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "kernels/cuda/cuda_device.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();

class CudaDensification : public ::testing::Test {
  protected:
    void SetUp() override {
        if (!cuda_available()) GTEST_SKIP() << "no CUDA device: " << cuda_unavailable_reason();
    }
};

/// Both backends with the same model.
struct Both {
    std::unique_ptr<Backend> cpu, gpu;
    explicit Both(const Gaussians& s) : cpu(make_cpu_backend(s.appearance)), gpu(make_cuda_backend(s.appearance)) {
        cpu->upload(s), gpu->upload(s);
    }

    /// Expects the same bits, and of the groups `inexact`, in which libm has a part, values within `tolerance`.
    void expect_same(float tolerance, std::initializer_list<Group> inexact) const {
        const Gaussians a = cpu->download(true), b = gpu->download(true);
        ASSERT_EQ(a.count, b.count);
        ASSERT_EQ(gpu->count(), b.count);
        for (int g = 0; g < kNumGroups; ++g) {
            const bool exact = std::find(inexact.begin(), inexact.end(), Group(g)) == inexact.end();
            expect_same(a.groups[g].param, b.groups[g].param, exact ? 0 : tolerance, kGroupNames[g]);
            expect_same(a.groups[g].m, b.groups[g].m, 0, kGroupNames[g]);
            expect_same(a.groups[g].v, b.groups[g].v, 0, kGroupNames[g]);
        }
        expect_same(a.gradient_sum, b.gradient_sum, 0, "gradient_sum");
        expect_same(a.gradient_count, b.gradient_count, 0, "gradient_count");
        expect_same(a.last_step, b.last_step, 0, "last_step");
    }
    static void expect_same(const std::vector<float>& a, const std::vector<float>& b, float tolerance,
                            const char* what) {
        ASSERT_EQ(a.size(), b.size()) << what;
        for (std::size_t i = 0; i < a.size(); ++i) {
            if (std::bit_cast<std::uint32_t>(a[i]) == std::bit_cast<std::uint32_t>(b[i]) ||
                (std::isnan(a[i]) && std::isnan(b[i])))
                continue;
            ASSERT_LE(std::abs(a[i] - b[i]), tolerance * std::max(1.0f, std::abs(a[i])))
                << what << " value " << i << ": " << a[i] << " and " << b[i];
        }
    }
};

void expect_same(const DensifyStats& a, const DensifyStats& b) {
    EXPECT_EQ(a.relocated, b.relocated);
    EXPECT_EQ(a.added, b.added);
    EXPECT_EQ(a.cloned, b.cloned);
    EXPECT_EQ(a.split, b.split);
    EXPECT_EQ(a.pruned, b.pruned);
    EXPECT_EQ(a.count, b.count);
}

/// Returns random rows whose moments, and with an odd seed also their last steps, tell them apart.
Gaussians random_model(std::int64_t n, int degree, std::uint32_t seed) {
    Gaussians s = cast<float>(random_gaussians(n, degree, seed));
    if (degree == 0) s.appearance.model = "none", s[Group::kResidual].width = 0, s[Group::kResidual].param.clear();
    for (auto& group : s.groups) {
        group.m.resize(group.param.size()), group.v.resize(group.param.size());
        std::iota(group.m.begin(), group.m.end(), 1.0f);
        std::iota(group.v.begin(), group.v.end(), 2.0f);
    }
    if (seed % 2) {
        s.last_step.resize(n);
        std::iota(s.last_step.begin(), s.last_step.end(), 1.0f);
    }
    return s;
}

/// Returns rows of which every 7th is faint, every 11th has no rotation, and every 13th is a copy of the row before.
Gaussians mixed_model(std::int64_t n, int degree, std::uint32_t seed) {
    Gaussians s = random_model(n, degree, seed);
    for (std::int64_t i = 0; i < n; ++i) {
        if (i % 7 == 3) s[Group::kOpacity].param[i] = -9;
        if (i % 11 == 5) std::fill_n(s[Group::kRotation].param.begin() + 4 * i, 4, 0.0f);
        if (i % 13 == 7)
            for (auto& group : s.groups)
                std::copy_n(group.param.begin() + (i - 1) * group.width, group.width,
                            group.param.begin() + i * group.width);
    }
    return s;
}

/// Fills the statistic with few different values, so that many gradients are equal.
void gather_statistic(Gaussians& s, std::uint32_t seed) {
    std::mt19937 rng(seed);
    const float sums[] = {0, 1e-4f, 2e-4f, 4e-4f, 1e-3f};
    s.gradient_sum.resize(s.count), s.gradient_count.resize(s.count);
    for (float& x : s.gradient_sum) x = sums[rng() % 5];
    for (float& x : s.gradient_count) x = float(rng() % 4);
}

TEST_F(CudaDensification, McmcMovesTheRowsOfTheCpu) {
    for (const std::int64_t n : {0, 1, 2, 19, 1000, 40000})
        for (const std::int64_t cap : {n / 2, n, n + 1, n + n / 12, 2 * n + 10}) {
            SCOPED_TRACE(std::to_string(n) + " Gaussians, cap " + std::to_string(cap));
            Gaussians s = mixed_model(n, n < 10000 ? 3 : 1, 7);
            if (n > 20)
                s[Group::kOpacity].param[8] = kNan, s[Group::kOpacity].param[9] = 60,
                s[Group::kOpacity].param[10] = -kInf;
            const Both both(s);
            McmcParams p;
            p.cap = cap;
            for (int k = 0; k < 4; ++k) {
                p.by_gradient = k % 2 == 1;
                expect_same(both.cpu->densify({p, 600 + 100 * k, 3}), both.gpu->densify({p, 600 + 100 * k, 3}));
                both.expect_same(5e-7f, {Group::kScale, Group::kOpacity});
            }
        }
}

TEST_F(CudaDensification, McmcTakesManyCopiesOfOne) {
    Gaussians s = random_model(300, 3, 8);
    std::fill(s[Group::kOpacity].param.begin(), s[Group::kOpacity].param.end(), -9.0f);
    const Both dead(s);
    McmcParams p;
    p.cap = 300;
    expect_same(dead.cpu->densify({p, 600, 1}), dead.gpu->densify({p, 600, 1}));  // nowhere to go
    dead.expect_same(0, {});
    s[Group::kOpacity].param[123] = 4;
    const Both one(s);
    p.cap = 2000, p.growth = 3;
    expect_same(one.cpu->densify({p, 600, 1}), one.gpu->densify({p, 600, 1}));
    one.expect_same(5e-7f, {Group::kScale, Group::kOpacity});
}

TEST_F(CudaDensification, McmcRepeatsItself) {
    const Gaussians s = mixed_model(20000, 1, 9);
    McmcParams p;
    p.cap = 30000;
    Gaussians first;
    for (int k = 0; k < 3; ++k) {
        const auto gpu = make_cuda_backend(s.appearance);
        gpu->upload(s);
        for (int i = 0; i < 5; ++i) gpu->densify({p, 600 + 100 * i, 3});
        const Gaussians now = gpu->download(true);
        if (k == 0) first = now;
        for (int g = 0; g < kNumGroups; ++g) {
            EXPECT_EQ(now.groups[g].param, first.groups[g].param);
            EXPECT_EQ(now.groups[g].m, first.groups[g].m);
        }
    }
}

TEST_F(CudaDensification, AdcBuildsTheModelOfTheCpu) {
    for (const std::int64_t n : {1, 2, 1000, 40000})
        for (const std::int64_t cap : {std::int64_t(0), n / 2, n, n + 1, n + n / 10, 3 * n})
            for (const bool statistic : {true, false}) {
                SCOPED_TRACE(std::to_string(n) + " Gaussians, cap " + std::to_string(cap) +
                             (statistic ? "" : ", no statistic"));
                Gaussians s = mixed_model(n, n < 10000 ? 3 : 0, 11);
                if (statistic) gather_statistic(s, 5);
                if (n > 20) s[Group::kScale].param[30] = kNan, s[Group::kOpacity].param[12] = kNan;
                const Both both(s);
                AdcParams p;
                p.extent = 20;  // clone below a scale of 0.2, about the median
                p.cap = cap;
                for (int k = 0; k < 2; ++k) {  // the second time there is no statistic
                    p.prune_large = k == 1;
                    expect_same(both.cpu->densify({p, 600 + 100 * k, 3}), both.gpu->densify({p, 600 + 100 * k, 3}));
                    both.expect_same(2e-6f, {Group::kMean});
                }
            }
}

TEST_F(CudaDensification, AdcGrowsAgainAndAgain) {
    Gaussians s = random_model(500, 3, 12);
    AdcParams p;
    p.extent = 20;
    for (int k = 0; k < 6; ++k) {
        gather_statistic(s, 20 + k);
        const Both both(s);
        expect_same(both.cpu->densify({p, 600 + 100 * k, 3}), both.gpu->densify({p, 600 + 100 * k, 3}));
        both.expect_same(2e-6f, {Group::kMean});
        s = both.gpu->download(true);
    }
    EXPECT_GT(s.count, 1000);
}

TEST_F(CudaDensification, AdcMovesTheResidualsOfEveryModel) {
    for (const ModelInfo* info : appearance_models()) {
        SCOPED_TRACE(info->name);
        Gaussians s = random_model(700, 1, 21);
        s.appearance = {info->name, info->max_degree_limit, ColorActivation::kRelu};
        auto& residuals = s[Group::kResidual];
        residuals.width = info->residual_width(info->max_degree_limit);
        residuals.param.resize(std::size_t(s.count) * residuals.width);
        std::iota(residuals.param.begin(), residuals.param.end(), 1.0f);
        residuals.m = residuals.v = residuals.param;
        s.shared.width = info->num_shared;
        s.shared.param.assign(std::size_t(info->num_shared), 0.25f);
        gather_statistic(s, 22);
        const Both both(s);
        AdcParams p;
        p.extent = 20;
        const DensifyStats stats = both.gpu->densify({p, 600, 3});
        expect_same(both.cpu->densify({p, 600, 3}), stats);
        EXPECT_GT(stats.cloned, 0);
        EXPECT_GT(stats.split, 0);
        both.expect_same(2e-6f, {Group::kMean});
        Both::expect_same(both.cpu->download(true).shared.param, both.gpu->download(true).shared.param, 0,
                          "shared weights");
    }
}

/// Returns rows that ADC prunes, all of them.
Gaussians faint_model(std::int64_t n) {
    Gaussians s = random_model(n, 3, 13);
    std::fill(s[Group::kOpacity].param.begin(), s[Group::kOpacity].param.end(), -9.0f);
    gather_statistic(s, 6);
    return s;
}

TEST_F(CudaDensification, AdcMayRemoveAllOfARank) {
    for (const std::int64_t n : {0, 3}) {
        const Both both(faint_model(n));
        AdcParams p;
        p.may_remove_all = true;
        expect_same(both.cpu->densify({p, 600, 1}), both.gpu->densify({p, 600, 1}));
        EXPECT_EQ(both.gpu->count(), 0);
        both.expect_same(0, {});
    }
}

TEST_F(CudaDensification, AdcThatLeavesNothingIsTheSameError) {
    for (const std::int64_t n : {0, 3}) {
        const Both both(faint_model(n));
        std::string messages[2];
        for (int k = 0; k < 2; ++k) {
            try {
                (k ? both.gpu : both.cpu)->densify({AdcParams{}, 600, 1});
                ADD_FAILURE() << "no error";
            } catch (const UsageError& e) {
                messages[k] = e.what();
            }
        }
        EXPECT_EQ(messages[0], messages[1]);
    }
}

TEST_F(CudaDensification, OpacityResetIsTheOneOfTheCpu) {
    for (const std::int64_t n : {0, 1, 3000}) {
        Gaussians s = mixed_model(n, 1, 14);
        if (n > 1) s[Group::kOpacity].param[5] = kNan, s[Group::kOpacity].param[6] = kInf;
        const Both both(s);
        both.cpu->densify({OpacityReset{}, 0, 0}), both.gpu->densify({OpacityReset{}, 0, 0});
        both.expect_same(0, {});
    }
}

TEST_F(CudaDensification, MortonOrderIsTheOneOfTheCpu) {
    for (const std::int64_t n : {0, 1, 2, 1000, 30000}) {
        Gaussians s = mixed_model(n, n < 10000 ? 3 : 0, 15);
        gather_statistic(s, 7);
        const Both both(s);
        both.cpu->morton_sort(), both.gpu->morton_sort();
        both.expect_same(0, {});
    }
    Gaussians equal = random_model(100, 1, 16);  // of equal places the order stays
    std::fill(equal[Group::kMean].param.begin(), equal[Group::kMean].param.end(), 0.5f);
    Gaussians bad = random_model(100, 1, 17);
    for (float x : {kNan, kInf, -kInf, 1e38f, -1e38f}) {
        bad[Group::kMean].param[std::size_t(rand() % 300)] = x;
        for (const Gaussians& s : {equal, bad}) {
            const Both both(s);
            both.cpu->morton_sort(), both.gpu->morton_sort();
            both.expect_same(0, {});
        }
    }
}

/// A gather of so many rows cannot take all columns of a residual at once.
TEST_F(CudaDensification, RowsOfALargeModelMoveInSlices) {
    const Gaussians s = random_model(400000, 3, 18);
    const Both both(s);
    both.cpu->morton_sort(), both.gpu->morton_sort();
    both.expect_same(0, {});
}

TEST_F(CudaDensification, PruningRemovesTheRowsOfTheCpu) {
    for (const std::int64_t n : {0, 1, 500, 20000})
        for (const int spacing : {0, 1, 3, 97}) {  // none, all, many, few
            SCOPED_TRACE(std::to_string(n) + " Gaussians, spacing " + std::to_string(spacing));
            Gaussians s = mixed_model(n, n < 10000 ? 3 : 0, 19);
            gather_statistic(s, 8);
            for (std::int64_t i = 0; spacing && i < n; i += spacing) {
                auto& group =
                    s.groups[std::size_t(i / spacing) % std::size_t(n < 10000 ? Group::kSmoothing : Group::kResidual)];
                group.param[std::size_t((i + 1) * group.width - 1)] = i % 2 ? kNan : -kInf;
                if (i % 5 == 0) s[Group::kMean].param[3 * i] = kInf;  // several groups of one row
            }
            const Both both(s);
            const PruneStats a = both.cpu->prune_nonfinite(), b = both.gpu->prune_nonfinite();
            EXPECT_EQ(a.removed, b.removed);
            for (int g = 0; g < kNumGroups; ++g) EXPECT_EQ(a.by_group[g], b.by_group[g]) << kGroupNames[g];
            both.expect_same(0, {});
            EXPECT_EQ(both.cpu->prune_invisible(), both.gpu->prune_invisible());
            both.expect_same(0, {});
            EXPECT_EQ(both.gpu->prune_invisible(), 0);
        }
}

/// Does everything on one backend, as trainers do, so that memory of earlier calls is used again.
TEST_F(CudaDensification, AllOperationsFollowEachOther) {
    for (const bool filtered : {false, true}) {
        SCOPED_TRACE(filtered ? "with a 3-D filter" : "");
        Gaussians s = mixed_model(3000, 3, 20);
        if (filtered) s = antialiased(s);
        gather_statistic(s, 9);
        const Both both(s);
        AdcParams adc;
        adc.extent = 20;
        McmcParams mcmc;
        mcmc.cap = 6000;
        for (Backend* backend : {both.cpu.get(), both.gpu.get()}) {
            backend->morton_sort();
            backend->densify({adc, 600, 1});
            backend->densify({mcmc, 700, 1});
            backend->update_smoothing({cast<float>(test_camera(60, 40)), cast<float>(test_camera(90, 50))});
            backend->prune_nonfinite();
            backend->densify({mcmc, 800, 1});
            backend->prune_invisible();
            backend->densify({OpacityReset{}, 0, 0});
            backend->densify({mcmc, 900, 1});
        }
        both.expect_same(2e-6f, {Group::kMean, Group::kScale, Group::kOpacity, Group::kSmoothing});
    }
}

/// Leaves the residuals of the first `rows` Gaussians.
Gaussians with_residuals(Gaussians s, std::int64_t rows) {
    auto& group = s[Group::kResidual];
    for (auto* data : {&group.param, &group.m, &group.v}) data->resize(std::size_t(rows) * group.width);
    return s;
}

TEST_F(CudaDensification, MixedModelsMoveLikeThoseOfTheCpu) {
    for (const std::int64_t n : {1, 19, 1000, 40000})
        for (const std::int64_t rows : {std::int64_t(0), n / 3, n - 1}) {
            SCOPED_TRACE(std::to_string(rows) + " residuals of " + std::to_string(n));
            Gaussians s = with_residuals(mixed_model(n, n < 10000 ? 3 : 1, 7), rows);
            gather_statistic(s, 3);
            const Both both(s);
            EXPECT_EQ(both.gpu->num_residuals(), rows);
            both.expect_same(0, {});
            const DensifyRequest mcmc{McmcParams{.cap = 2 * n}, 700, 5}, adc{AdcParams{.dense_fraction = 0.2f}, 800, 5};
            expect_same(both.cpu->densify(mcmc), both.gpu->densify(mcmc));
            both.expect_same(1e-5f, {Group::kOpacity, Group::kScale});
            both.cpu->morton_sort(), both.gpu->morton_sort();
            both.expect_same(1e-5f, {Group::kOpacity, Group::kScale});
            EXPECT_EQ(both.cpu->prune_invisible(), both.gpu->prune_invisible());
            both.expect_same(1e-5f, {Group::kOpacity, Group::kScale});
            if (n < 1000) continue;
            const Both again(s);
            expect_same(again.cpu->densify(adc), again.gpu->densify(adc));
            again.expect_same(1e-5f, {Group::kMean, Group::kScale});
            EXPECT_EQ(again.gpu->num_residuals(), again.cpu->num_residuals());
        }
}

TEST_F(CudaDensification, KeepingResidualsMovesTheRowsOfTheCpu) {
    for (const std::int64_t n : {0, 1, 19, 1000, 40000})
        for (const std::int64_t rows : {n / 2, n}) {
            SCOPED_TRACE(std::to_string(rows) + " residuals of " + std::to_string(n));
            const Both both(with_residuals(random_model(n, n < 10000 ? 3 : 1, 7), rows));
            std::vector<std::uint8_t> marks(std::size_t(n), 0);
            for (std::size_t i = 0; i < marks.size(); ++i) marks[i] = i % 5 == 1 || i % 7 == 2;
            std::vector<float> bases(3 * marks.size());
            std::iota(bases.begin(), bases.end(), 0.0f);
            both.cpu->keep_residuals(marks, bases), both.gpu->keep_residuals(marks, bases);
            EXPECT_EQ(both.cpu->num_residuals(), both.gpu->num_residuals());
            both.expect_same(0, {});
            std::fill(marks.begin(), marks.end(), 0);
            both.cpu->keep_residuals(marks, {}), both.gpu->keep_residuals(marks, {});
            EXPECT_EQ(both.gpu->num_residuals(), 0);
            both.expect_same(0, {});
        }
}

TEST_F(CudaDensification, BrokenResidualsOfMixedModelsAreFound) {
    Gaussians s = with_residuals(random_model(1000, 2, 7), 300);
    s[Group::kResidual].param[24 * 299 + 23] = kNan;
    s[Group::kMean].param[3 * 999] = kInf;
    const Both both(s);
    const PruneStats a = both.cpu->prune_nonfinite(), b = both.gpu->prune_nonfinite();
    EXPECT_EQ(b.removed, 2);
    EXPECT_EQ(a.by_group, b.by_group);
    both.expect_same(0, {});
}

}  // namespace
}  // namespace gs::test
