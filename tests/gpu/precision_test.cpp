// SPDX-License-Identifier: Apache-2.0
// The settings that trade accuracy for speed: each does what it says, and nothing else. Skipped where there is no
// device.
#include <algorithm>
#include <bit>

#include "tests/gpu/scenes.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

constexpr int kWidth = 160, kHeight = 120;

class GpuPrecision : public Gpu {
  protected:
    const TestScene scene_ = random_scene(4000, 3, kWidth, kHeight, -1, 6);
    const RandomTarget target_{kWidth, kHeight, 3};

    RenderedImage frame(Backend& backend) const {
        RenderRequest r;
        r.camera = cast<float>(scene_.camera);
        RenderedImage image;
        backend.render(r, image);
        return image;
    }
    RenderedImage frame_with(const EngineOptions& options) const {
        const auto gpu = make_cuda_backend(scene_.model.appearance, options);
        gpu->upload(scene_.model);
        return frame(*gpu);
    }
    StepRequest request(std::int64_t k) const {
        StepRequest r = step_request(cast<float>(scene_.camera), target_.image());
        r.iteration = k, r.seed = 7;
        return r;
    }
};

struct Difference {
    double mean = 0, worst = 0;
};
Difference compare(const std::vector<float>& a, const std::vector<float>& b) {
    Difference d;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const double x = std::abs(double(a[i]) - b[i]);
        d.mean += x / double(a.size()), d.worst = std::max(d.worst, x);
    }
    return d;
}

/// Rounding decides about single fragments at the cutoff, so a few pixels may differ by at most what is cut off.
TEST_F(GpuPrecision, CutoffsAreThoseOfTheCpu) {
    const EngineOptions options{.min_alpha = 4.0 / 255, .min_transmittance = 0.01};
    const auto cpu = make_cpu_backend(scene_.model.appearance, options),
               gpu = make_cuda_backend(scene_.model.appearance, options);
    cpu->upload(scene_.model), gpu->upload(scene_.model);
    const Difference same = compare(frame(*cpu).rgb, frame(*gpu).rgb),
                     cut = compare(frame_with({}).rgb, frame(*gpu).rgb);
    std::printf("mean difference to the CPU's %.1e (worst %.1e), to no cutoffs %.1e (%.1e)\n", same.mean, same.worst,
                cut.mean, cut.worst);
    EXPECT_LT(same.mean, 1e-6);
    EXPECT_GT(cut.mean, 1e-4);
    cpu->step(request(0)), gpu->step(request(0));
    const Gaussians a = cpu->download(true), b = gpu->download(true);
    for (int g = 0; g < int(Group::kSmoothing); ++g) {
        double difference = 0, sum = 0;
        for (std::size_t i = 0; i < a.groups[g].m.size(); ++i)
            difference += std::abs(double(a.groups[g].m[i]) - b.groups[g].m[i]),
                sum += std::abs(double(a.groups[g].m[i]));
        EXPECT_GT(sum, 0);
        EXPECT_LE(difference, 2e-3 * sum) << kGroupNames[g];
    }
}

/// Frames are bitwise those of the rounded parameters, after steps and densification too; steps see single precision.
TEST_F(GpuPrecision, HalfStorageRoundsWhatFramesRead) {
    const auto rounded = [](Gaussians g) {
        for (float& x : g[Group::kResidual].param) x = float(_Float16(x));
        return g;
    };
    const auto plain = make_cuda_backend(scene_.model.appearance, {.deterministic = true}),
               half = make_cuda_backend(scene_.model.appearance, {.deterministic = true, .half_residuals = true});
    const auto of_rounded = make_cuda_backend(scene_.model.appearance, {.deterministic = true});
    plain->upload(scene_.model), half->upload(scene_.model);
    McmcParams mcmc;
    mcmc.cap = 5000;
    for (int k = 0; k < 3; ++k) {
        of_rounded->upload(rounded(plain->download(false)));
        EXPECT_EQ(frame(*of_rounded).rgb, frame(*half).rgb);
        EXPECT_NE(frame(*plain).rgb, frame(*half).rgb);
        for (auto* backend : {plain.get(), half.get()})
            if (k == 0)
                backend->step(request(k));
            else
                backend->densify({mcmc, k, 7});
    }
    expect_same_bits(plain->download(true), half->download(true));
}

TEST_F(GpuPrecision, PackedMomentsAreMomentsOfEightBits) {
    const auto plain = make_cuda_backend(scene_.model.appearance, {.deterministic = true}),
               packed = make_cuda_backend(scene_.model.appearance, {.deterministic = true, .packed_moments = true});
    for (auto* backend : {plain.get(), packed.get()}) backend->upload(scene_.model), backend->step(request(0));
    const Gaussians a = plain->download(true), b = packed->download(true);
    const auto &x = a[Group::kResidual], &y = b[Group::kResidual];
    EXPECT_EQ(x.param, y.param) << "moments of 0 are exact, so is the first step";
    std::int64_t rounded = 0;
    for (std::size_t i = 0; i < x.m.size(); ++i) {
        ASSERT_NEAR(y.m[i], x.m[i], std::abs(x.m[i]) / 256 + 1e-38);
        ASSERT_NEAR(y.v[i], x.v[i], x.v[i] / 128 + 1e-38);
        ASSERT_EQ(std::bit_cast<std::uint32_t>(y.m[i]) & 0xffff, 0);
        rounded += y.m[i] != x.m[i];
    }
    EXPECT_GT(rounded, std::int64_t(x.m.size() / 4));
    for (int g = 0; g < kNumGroups; ++g)
        if (Group(g) != Group::kResidual) {
            EXPECT_EQ(a.groups[g].v, b.groups[g].v) << kGroupNames[g];
        }
    // What is read back goes up again as it was.
    const auto again = make_cuda_backend(scene_.model.appearance, {.packed_moments = true});
    again->upload(b);
    expect_same_bits(again->download(true), b);
}

/// Takes every kind of step and moves rows, among them residuals that are caught up late.
TEST_F(GpuPrecision, PackedMomentsTrainLikeFullOnes) {
    const auto train = [&](const EngineOptions& options) {
        const auto gpu = make_cuda_backend(scene_.model.appearance, options);
        gpu->upload(scene_.model);
        McmcParams mcmc;
        mcmc.cap = 5000;
        AdcParams adc;
        adc.grad_threshold = 1e-5f, adc.cap = 6000;
        for (int k = 0; k < 200; ++k) {
            StepRequest r = request(k);
            if (k % 4) r.camera.fx *= 3, r.camera.fy *= 3;
            gpu->step(r);
            if (k == 60) gpu->densify({mcmc, k, 7});
            if (k == 120) gpu->densify({adc, k, 7});
            if (k == 150) gpu->morton_sort();
        }
        gpu->synchronize();
        const double loss = gpu->take_stats().loss;
        return std::pair(loss, gpu->download(true));
    };
    const auto [loss, full] = train({.deterministic = true});
    const auto [packed_loss, packed] = train({.deterministic = true, .packed_moments = true});
    std::printf("loss %.6f, with packed moments %.6f\n", loss, packed_loss);
    EXPECT_NEAR(packed_loss, loss, 0.01 * loss);
    EXPECT_NEAR(packed.count, full.count, 0.02 * double(full.count));
    const auto& group = packed[Group::kResidual];
    EXPECT_TRUE(std::all_of(group.v.begin(), group.v.end(), [](float v) { return v >= 0 && std::isfinite(v); }));
    expect_same_bits(train({.deterministic = true, .packed_moments = true}).second, packed);
}

TEST_F(GpuPrecision, PackedMomentsTakeLessMemory) {
    const auto bytes = [&](bool packed) {
        const auto gpu = make_cuda_backend(scene_.model.appearance, {.packed_moments = packed});
        gpu->upload(scene_.model);
        return gpu->memory().rows.at(0).bytes;
    };
    EXPECT_EQ(bytes(false) - bytes(true), 4 * std::int64_t(scene_.model[Group::kResidual].param.size()));
}

}  // namespace
}  // namespace gs::test
