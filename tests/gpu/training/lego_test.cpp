// SPDX-License-Identifier: Apache-2.0
// Training on photographs from the same seeds on the CPU and on the device: the same quality. Skipped where there is no
// device or no dataset (GSAPP_TEST_DATA).
#include <spdlog/spdlog.h>

#include "eval/runs/evaluate.h"
#include "kernels/ranks/backend.h"
#include "lib/core/options.h"
#include "lib/train/trainer.h"
#include "tests/core/temporary_folder.h"
#include "tests/core/test_data.h"
#include "tests/gpu/gpu_test.h"

namespace gs::test {
namespace {

namespace fs = std::filesystem;

class GpuTraining : public ::testing::TestWithParam<Strategy> {
  protected:
    fs::path data_;
    void SetUp() override {
        skip_without_device();
        data_ = test_data("tiny/lego");
        if (!IsSkipped() && data_.empty()) GTEST_SKIP() << "no tiny/lego in GSAPP_TEST_DATA";
        spdlog::set_level(spdlog::level::err);
    }

    struct Result {
        double psnr = 0, seconds = 0;
        std::int64_t count = 0;
    };
    Result train_on(Device device, std::uint64_t seed, Scene& scene, const fs::path& folder) const {
        TrainOptions o;
        o.source = data_.string(), o.model = folder.string(), o.eval = true;
        o.iterations = 600, o.device = device, o.seed = seed;
        o.strategy = GetParam();
        o.init_points = 8000, o.cap_max = 12000;
        o.densify_from_iter = 100, o.densify_until_iter = 550, o.densification_interval = 100;
        o = resolve(o);
        Result result;
        TrainHooks hooks;
        hooks.evaluate = [&](std::int64_t iteration, Backend& backend, bool) {
            if (iteration == o.iterations) result.psnr = evaluate_views(backend, scene.test, {0, 0, 0}, {}).psnr;
            return std::nullopt;
        };
        Progress progress(ProgressStyle::kSilent);
        const TrainSummary summary = train(o, scene, open_run(o), progress, hooks);
        result.count = summary.num_gaussians, result.seconds = summary.train_seconds;
        return result;
    }
};
INSTANTIATE_TEST_SUITE_P(Strategies, GpuTraining, ::testing::Values(Strategy::kMcmc, Strategy::kAdc));

TEST_P(GpuTraining, ReachesTheQualityOfTheCpu) {
    SceneOptions options;
    options.source = data_.string(), options.eval = true;
    Scene scene = load_scene(options);
    ASSERT_GT(scene.test.size(), 5u);
    const TemporaryFolder tmp;
    // A learning rate changed by 1e-6 scatters the PSNR of one run by 0.045 dB: training is chaotic. The difference
    // between means of six scatters by 0.026 dB.
    constexpr int kSeeds = 6;
    double cpu_psnr = 0, gpu_psnr = 0, gpu_seconds = 0;
    for (int seed = 0; seed < kSeeds; ++seed) {
        const std::string name = std::to_string(seed);
        const Result cpu = train_on(Device::kCpu, seed, scene, tmp.path() / ("cpu" + name)),
                     gpu = train_on(Device::kCuda, seed, scene, tmp.path() / ("cuda" + name));
        std::printf("  seed %d: CPU %.3f dB, %lld Gaussians, %.2f s; CUDA %.3f dB, %lld Gaussians, %.2f s\n", seed,
                    cpu.psnr, (long long)cpu.count, cpu.seconds, gpu.psnr, (long long)gpu.count, gpu.seconds);
        cpu_psnr += cpu.psnr / kSeeds, gpu_psnr += gpu.psnr / kSeeds, gpu_seconds = std::max(gpu_seconds, gpu.seconds);
    }
    std::printf("  mean over seeds: CPU %.3f dB, CUDA %.3f dB\n", cpu_psnr, gpu_psnr);
    EXPECT_GT(cpu_psnr, 20) << "600 iterations train something";
    EXPECT_NEAR(gpu_psnr, cpu_psnr, 0.1);
    EXPECT_LT(gpu_seconds, 20);
}

}  // namespace
}  // namespace gs::test
