// SPDX-License-Identifier: Apache-2.0
// --deterministic: the same bits again; and images kept on the device or uploaded for every step. Skipped where there
// is no device.
#include "tests/gpu/scenes.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

constexpr int kViews = 4, kWidth = 160, kHeight = 120;

struct Views {
    std::vector<CameraParams<float>> cameras;
    std::vector<RandomTarget> targets;
    Views() {
        for (int k = 0; k < kViews; ++k) {
            auto c = test_camera(kWidth, kHeight);
            c.translation.x += 0.2 * k, c.position = c.rotation.transposed_times(c.translation) * -1.0;
            cameras.push_back(cast<float>(c));
            targets.emplace_back(kWidth, kHeight, k % 2 ? 4 : 3, k == 2, k == 3, 10 + k);
        }
    }
    StepRequest request(int k, bool with_ids) const {
        StepRequest r = step_request(cameras[k % kViews], targets[k % kViews].image(with_ids ? k % kViews : -1));
        r.iteration = k, r.rates.noise = 80, r.seed = 7;
        return r;
    }
};

class GpuDeterministic : public Gpu {
  protected:
    const Views views_;
    const TestScene scene_ = random_scene(4000, 3, kWidth, kHeight, -1, 6);

    /// Takes 30 steps; a densification follows every tenth, twice MCMC and once ADC.
    Gaussians train(const EngineOptions& options, bool with_ids = true) const {
        const auto gpu = make_cuda_backend(scene_.model.appearance, options);
        gpu->upload(scene_.model);
        McmcParams mcmc;
        mcmc.cap = 9000;
        AdcParams adc;
        adc.grad_threshold = 1e-5f, adc.cap = 7000;
        for (int k = 0; k < 30; ++k) {
            gpu->step(views_.request(k, with_ids));
            if (k % 10 != 9) continue;
            const DensifyStats stats = k == 19 ? gpu->densify({adc, k, 7}) : gpu->densify({mcmc, k, 7});
            EXPECT_GT(stats.added + stats.relocated + stats.cloned + stats.split, 0)
                << "a densification that changed nothing";
        }
        return gpu->download(true);
    }
};

TEST_F(GpuDeterministic, TrainingRepeatsItselfToTheBit) {
    const Gaussians a = train({.deterministic = true}), b = train({.deterministic = true});
    EXPECT_GT(a.count, scene_.model.count);
    expect_same_bits(a, b);
    EXPECT_NE(a[Group::kMean].param, scene_.model[Group::kMean].param);
}

/// Only the order of additions differs, by a few roundings of each sum's terms. The tolerance of 1e-4 of the group's
/// largest gradient is ten times what the error bounds of this scene allow (step_test.cpp compares both with the
/// reference).
TEST_F(GpuDeterministic, OneStepIsThatOfTheFastMode) {
    Gaussians after[2];
    for (const bool fixed_order : {false, true}) {
        const auto gpu = make_cuda_backend(scene_.model.appearance, {.deterministic = fixed_order});
        gpu->upload(scene_.model);
        gpu->step(views_.request(0, false));
        after[fixed_order] = gpu->download(true);
    }
    for (int g = 0; g < int(Group::kSmoothing); ++g) {
        double worst = 0, largest = 0;
        for (std::size_t i = 0; i < after[0].groups[g].m.size(); ++i) {
            worst = std::max(worst, std::abs(double(after[0].groups[g].m[i]) - after[1].groups[g].m[i]));
            largest = std::max(largest, std::abs(double(after[1].groups[g].m[i])));
        }
        std::printf("  %-14s %.1e of %.1e\n", kGroupNames[g], worst, largest);
        EXPECT_GT(largest, 0);
        EXPECT_LE(worst, 1e-4 * largest) << kGroupNames[g];
    }
}

/// Compares no image kept, all kept, room for one of the four, and targets without a name, which are never kept.
TEST_F(GpuDeterministic, ImagesKeptOrUploadedForEveryStepGiveTheSameBits) {
    const Gaussians kept = train({.deterministic = true});
    for (const std::int64_t budget : {0, 3 * kWidth * kHeight + 1000}) {
        SCOPED_TRACE("budget of " + std::to_string(budget) + " bytes");
        expect_same_bits(train({.deterministic = true, .image_budget = budget}), kept);
    }
    expect_same_bits(train({.deterministic = true}, false), kept);
}

TEST_F(GpuDeterministic, TheImageBudgetIsKept) {
    for (const auto& [budget, num_kept] : {std::pair{std::int64_t(0), 0},
                                           {std::int64_t(3 * kWidth * kHeight + 1000), 1},
                                           {std::int64_t(1) << 30, kViews}}) {
        const auto gpu = make_cuda_backend(scene_.model.appearance, {.image_budget = budget});
        gpu->upload(scene_.model);
        for (int k = 0; k < 2 * kViews; ++k) gpu->step(views_.request(k, true));
        gpu->synchronize();
        bool found = false;
        for (const auto& row : gpu->memory().rows) {
            if (row.what != "images kept on the device") continue;
            found = true;
            EXPECT_EQ(row.items, num_kept) << "budget of " << budget << " bytes";
            EXPECT_LE(row.bytes, budget);
        }
        EXPECT_TRUE(found);
    }
}

}  // namespace
}  // namespace gs::test
