// SPDX-License-Identifier: Apache-2.0
// Row operations on models in which only some Gaussians have a residual: they must do what they do to a model in which
// all have one, and then forget the residuals of the others.
#include <gtest/gtest.h>

#include <numeric>

#include "kernels/blend/residual_score.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/residual_handles.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/lowest_scores.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

constexpr std::int64_t kRows = 400, kWith = 150;

/// Returns random rows; some are faint, large or without a rotation. The first value of a residual is 1 in the rows
/// below `marked`, else 0 like its moments. Other moments tell rows apart.
Gaussians model_of(std::int64_t marked) {
    Gaussians s = cast<float>(random_gaussians(kRows, 1, 3));
    for (auto& group : s.groups) {
        group.m.resize(group.param.size()), group.v.resize(group.param.size());
        std::iota(group.m.begin(), group.m.end(), 1.0f);
        std::iota(group.v.begin(), group.v.end(), 2.0f);
    }
    for (std::int64_t i = 0; i < kRows; ++i) {
        if (i % 7 == 3) s[Group::kOpacity].param[i] = -9;
        if (i % 11 == 5) std::fill_n(s[Group::kRotation].param.begin() + 4 * i, 4, 0.0f);
        auto& residuals = s[Group::kResidual];
        residuals.param[9 * i] = i < marked;
        if (i >= marked) std::fill_n(&residuals.m[9 * i], 9, 0.0f), std::fill_n(&residuals.v[9 * i], 9, 0.0f);
    }
    s.gradient_sum.resize(kRows), s.gradient_count.assign(kRows, 2.0f);
    for (std::int64_t i = 0; i < kRows; ++i) s.gradient_sum[i] = 1e-4f * float(i % 9), s.last_step.push_back(float(i));
    return s;
}

/// Cuts the residuals of all rows but the first `rows` off.
void cut(Gaussians& s, std::int64_t rows) {
    auto& group = s[Group::kResidual];
    for (auto* data : {&group.param, &group.m, &group.v}) data->resize(std::size_t(rows) * group.width);
}

/// Moves the marked rows to the front and cuts the residuals of the others off.
void sort_and_cut(Gaussians& s) {
    std::vector<std::uint32_t> order(std::size_t(s.count));
    std::iota(order.begin(), order.end(), 0u);
    const auto end = std::stable_partition(order.begin(), order.end(),
                                           [&](std::uint32_t i) { return s[Group::kResidual].param[9 * i] != 0; });
    const std::int64_t rows = end - order.begin();
    gather_rows(s, order);
    cut(s, rows);
}

void expect_same(const Gaussians& a, const Gaussians& b) {
    ASSERT_EQ(a.count, b.count);
    for (int g = 0; g < kNumGroups; ++g) {
        EXPECT_EQ(a.groups[g].width, b.groups[g].width);
        EXPECT_EQ(a.groups[g].param, b.groups[g].param) << g;
        EXPECT_EQ(a.groups[g].m, b.groups[g].m) << g;
        EXPECT_EQ(a.groups[g].v, b.groups[g].v) << g;
    }
    EXPECT_EQ(a.gradient_sum, b.gradient_sum);
    EXPECT_EQ(a.last_step, b.last_step);
}

template <class Operation> void expect_same_as_with_all(Operation operation) {
    for (const std::int64_t with : {std::int64_t(0), kWith, kRows - 1}) {
        SCOPED_TRACE(with);
        Gaussians mixed = model_of(with), all = mixed;
        cut(mixed, with);
        operation(mixed), operation(all);
        sort_and_cut(all);
        expect_same(mixed, all);
        EXPECT_EQ(mixed.num_residuals(), std::int64_t(all[Group::kResidual].param.size()) / 9);
    }
}

TEST(MixedRows, McmcMovesThem) {
    expect_same_as_with_all([](Gaussians& s) {
        const DensifyStats stats = mcmc_densify(s, {.cap = 2 * kRows}, 700, 5);
        EXPECT_GT(stats.relocated, 0);
        EXPECT_GT(stats.added, 0);
    });
}

TEST(MixedRows, AdcMovesThem) {
    expect_same_as_with_all([](Gaussians& s) {
        const DensifyStats stats = adc_densify(s, {.dense_fraction = 0.2f}, 700, 5);
        EXPECT_GT(stats.cloned, 0);
        EXPECT_GT(stats.split, 0);
        EXPECT_GT(stats.pruned, 0);
    });
}

TEST(MixedRows, PruningAndSortingMoveThem) {
    expect_same_as_with_all([](Gaussians& s) { EXPECT_GT(remove_invisible(s), 0); });
    expect_same_as_with_all([](Gaussians& s) { gather_rows(s, morton_order(s)); });
    expect_same_as_with_all([](Gaussians& s) {
        std::vector<float> scores(std::size_t(s.count));
        for (std::size_t i = 0; i < scores.size(); ++i) scores[i] = float(i * 7919 % 1009);
        EXPECT_GT(remove_lowest_scores(s, scores, 0.3), 0);
    });
}

TEST(MixedRows, ABrokenResidualGoesWithItsRow) {
    Gaussians s = model_of(kWith);
    cut(s, kWith);
    s[Group::kResidual].param[9 * 20 + 4] = std::numeric_limits<float>::quiet_NaN();
    s[Group::kMean].param[3 * (kRows - 1)] = std::numeric_limits<float>::infinity();
    std::int64_t by_group[kNumGroups];
    EXPECT_EQ(remove_nonfinite(s, by_group), 2);
    EXPECT_EQ(by_group[int(Group::kResidual)], 1);
    EXPECT_EQ(by_group[int(Group::kMean)], 1);
    EXPECT_EQ(s.num_residuals(), kWith - 1);
    EXPECT_EQ(s.count, kRows - 2);
}

TEST(MixedRows, KeepingResidualsGivesTheOthersTheirBase) {
    const Gaussians before = model_of(kRows);
    auto backend = make_cpu_backend(before.appearance);
    backend->upload(before);
    EXPECT_EQ(backend->num_residuals(), kRows);
    std::vector<std::uint8_t> marks(kRows, 0);
    std::vector<float> bases(3 * kRows);
    std::iota(bases.begin(), bases.end(), 0.0f);
    for (std::int64_t i = 0; i < kRows; i += 4) marks[i] = 1;
    backend->keep_residuals(marks, bases);
    const Gaussians after = backend->download(true);
    EXPECT_EQ(backend->num_residuals(), kRows / 4);
    const auto row = [](const Gaussians& s, Group g, std::int64_t i) {
        const auto& group = s[g];
        return std::vector<float>(group.param.begin() + i * group.width, group.param.begin() + (i + 1) * group.width);
    };
    for (std::int64_t k = 0; k < kRows; ++k) {
        const std::int64_t i = k < kRows / 4 ? 4 * k : (k - kRows / 4) / 3 * 4 + (k - kRows / 4) % 3 + 1;
        EXPECT_EQ(row(after, Group::kMean, k), row(before, Group::kMean, i)) << k;
        if (k < kRows / 4) {
            EXPECT_EQ(row(after, Group::kBase, k), row(before, Group::kBase, i)) << k;
            EXPECT_EQ(row(after, Group::kResidual, k), row(before, Group::kResidual, i)) << k;
        } else {
            EXPECT_EQ(row(after, Group::kBase, k), std::vector<float>(&bases[3 * i], &bases[3 * i] + 3)) << k;
        }
    }
    backend->keep_residuals(std::vector<std::uint8_t>(kRows, 0), {});
    EXPECT_EQ(backend->num_residuals(), 0);
    EXPECT_EQ(backend->download(false)[Group::kResidual].param.size(), 0u);
    EXPECT_EQ(backend->download(false)[Group::kBase].param, after[Group::kBase].param) << "without new base colours";
}

TEST(MixedRows, AreSeenLikeRowsOfZerosAndHaveTheSameGradients) {
    GaussianState<double> zeros = random_gaussians(40, 2, 11);
    auto& residuals = zeros[Group::kResidual];
    std::fill(residuals.param.begin() + 15 * residuals.width, residuals.param.end(), 0.0);
    GaussianState<double> mixed = zeros;
    mixed[Group::kResidual].param.resize(15 * std::size_t(residuals.width));
    const CameraParams<double> camera = test_camera(40, 30);
    const std::size_t pixels = 40 * 30;
    std::vector<double> images[2], transmittances[2], dL_dimage(3 * pixels);
    for (std::size_t k = 0; k < dL_dimage.size(); ++k) dL_dimage[k] = std::sin(double(k));
    CpuRasterizer<double, appearance::Sh> rasterizers[2];
    const GaussianState<double>* states[2] = {&zeros, &mixed};
    for (int k = 0; k < 2; ++k) {
        images[k].resize(3 * pixels), transmittances[k].resize(pixels);
        rasterizers[k].forward(ParameterView<double>::of(*states[k]), camera, {0.1, 0.2, 0.3}, 2, RenderMode::kFull,
                               images[k].data(), transmittances[k].data());
        rasterizers[k].backward(images[k].data(), transmittances[k].data(), dL_dimage.data());
    }
    EXPECT_EQ(images[0], images[1]);
    for (std::int64_t i = 0; i < 40; ++i) {
        CpuRasterizer<double, appearance::Sh>::FullGradient a, b;
        rasterizers[0].gaussian_gradient(ParameterView<double>::of(zeros), i, false, a, nullptr);
        rasterizers[1].gaussian_gradient(ParameterView<double>::of(mixed), i, false, b, nullptr);
        EXPECT_EQ(a.base.x, b.base.x) << i;
        EXPECT_EQ(a.geometry.log_scale.y, b.geometry.log_scale.y) << i;
        for (int c = 0; c < residuals.width; ++c) EXPECT_EQ(b.residual[c], i < 15 ? a.residual[c] : 0.0) << i;
        if (i < 15) {
            EXPECT_EQ(a.geometry.mean.x, b.geometry.mean.x) << i;  // a row of zeros still pulls at the direction
        }
    }
}

TEST(ResidualScore, IsWhatTheMeanColourCostsAnUnoccludedGaussian) {
    // Two views of one pixel that the Gaussian covers alone: colours c_v, photographs t_v.
    const float colors[2] = {0.7f, 0.3f}, targets[2] = {0.8f, 0.3f};
    ResidualSums sums{};
    double before = 0, after = 0;
    for (int v = 0; v < 2; ++v) {
        const float error = colors[v] - targets[v];
        sums.add(1, {error, error, error}, {colors[v], colors[v], colors[v]}, {0.45f, 0.45f, 0.45f});
        before += 1.5 * error * error, after += 1.5 * std::pow(0.5 - targets[v], 2);
    }
    EXPECT_NEAR(sums.worth(), after - before, 1e-6);
    EXPECT_NEAR(sums.mean_base(ColorActivation::kRelu, {-0.05f, -0.05f, -0.05f}).y, 0.0f, 1e-6);
    EXPECT_EQ(ResidualSums{}.worth(), 0);
    EXPECT_EQ(ResidualSums{}.mean_base(ColorActivation::kRelu, {9, 8, 7}).z, 7) << "no view shows it";
    ResidualSums bright{};
    bright.add(2, {0, 0, 0}, {3, 3, 3}, {2, 2, 2});
    EXPECT_FLOAT_EQ(bright.mean_base(ColorActivation::kRelu, {1.5f, 1.5f, 1.5f}).x, 2.5f) << "relu has no upper end";
    EXPECT_LT(bright.mean_base(ColorActivation::kSigmoid, {9, 9, 9}).x, 2);
}

}  // namespace
}  // namespace gs::test
