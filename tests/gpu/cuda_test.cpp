// SPDX-License-Identifier: Apache-2.0
// The CUDA backend against the CPU backend: images, one optimizer step, extremes. Skipped where there is no device.
#include <gtest/gtest.h>

#include "kernels/cuda_device.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

class Cuda : public ::testing::Test {
  protected:
    void SetUp() override {
        if (!cuda_available()) GTEST_SKIP() << "no CUDA device: " << cuda_unavailable_reason();
    }
};

struct Difference {
    double worst = 0, scale = 0;
    void add(double a, double b) { worst = std::max(worst, std::abs(a - b)), scale = std::max(scale, std::abs(b)); }
};

void expect_same_image(Gaussians s, int width, int height, double tolerance) {
    if (s.appearance.max_degree == 0) s.appearance.model = "none";
    const auto cpu = make_cpu_backend(s.appearance), gpu = make_cuda_backend(s.appearance);
    cpu->upload(s), gpu->upload(s);
    RenderRequest r;
    r.camera = cast<float>(test_camera(width, height));
    r.background = {0.3f, 0.6f, 0.1f};
    for (const RenderMode mode : {RenderMode::kFull, RenderMode::kBaseOnly, RenderMode::kResidualOnly}) {
        r.mode = mode;
        RenderedImage a, b;
        cpu->render(r, a), gpu->render(r, b);
        ASSERT_EQ(a.rgb.size(), b.rgb.size());
        std::size_t off = 0;
        double worst = 0;
        for (std::size_t i = 0; i < a.rgb.size(); ++i) {
            ASSERT_TRUE(std::isfinite(b.rgb[i]));
            worst = std::max(worst, double(std::abs(a.rgb[i] - b.rgb[i])));
            off += std::abs(a.rgb[i] - b.rgb[i]) > tolerance;
        }
        // Rounding may decide differently about a fragment at alpha = 1/255; then a pixel is off by up to 1/255.
        EXPECT_LE(off, a.rgb.size() / 5000) << width << "x" << height;
        EXPECT_LE(worst, 0.02);
        std::size_t above[4] = {};
        for (std::size_t i = 0; i < a.rgb.size(); ++i)
            for (int k = 0; k < 4; ++k) above[k] += std::abs(a.rgb[i] - b.rgb[i]) > 2e-5 * (1 << k);
        std::printf("above 2e-5 %zu, 4e-5 %zu, 8e-5 %zu, 16e-5 %zu\n", above[0], above[1], above[2], above[3]);
        std::printf("%dx%d, %lld Gaussians, mode %d: worst %.2e, %zu of %zu above %.0e\n", width, height, (long long)s.count, int(mode), worst, off, a.rgb.size(), tolerance);
    }
}

TEST_F(Cuda, ImagesAgreeWithTheCpu) {
    expect_same_image(cast<float>(random_gaussians(0, 3, 1)), 33, 25, 0);
    expect_same_image(cast<float>(random_gaussians(1, 3, 1)), 1, 1, 1e-5);
    expect_same_image(cast<float>(random_gaussians(60, 3, 2)), 17, 13, 1e-5);
    expect_same_image(cast<float>(random_gaussians(20000, 3, 3)), 800, 800, 2e-5);
    expect_same_image(cast<float>(random_gaussians(500, 0, 4)), 130, 70, 1e-5);
    expect_same_image(cast<float>(random_gaussians(2000, 3, 5)), 3840, 2160, 1e-5);
}

/// One step with rate 1 for each parameter and no moments moves every parameter by its sign; so compare the moments,
/// which after one step from zero are the gradients: m = 0.1 g.
void expect_same_gradients(Gaussians s, int width, int height, int channels, bool masked, double tolerance) {
    const auto cpu = make_cpu_backend(s.appearance), gpu = make_cuda_backend(s.appearance);
    cpu->upload(s), gpu->upload(s);
    std::vector<std::uint8_t> target(std::size_t(width) * height * channels), mask(std::size_t(width) * height);
    std::mt19937 rng(5);
    for (auto& x : target) x = std::uint8_t(rng());
    for (auto& x : mask) x = std::uint8_t(rng());
    StepRequest r;
    r.camera = cast<float>(test_camera(width, height));
    r.background = {0.3f, 0.6f, 0.1f};
    r.target = {width, height, channels, target.data(), nullptr, masked ? mask.data() : nullptr};
    r.gather_gradient_stats = true;
    for (double& rate : r.rates) rate = 1e-3;
    cpu->step(r), gpu->step(r);
    gpu->synchronize();
    EXPECT_NEAR(cpu->take_stats().loss, gpu->take_stats().loss, 1e-5);
    const Gaussians a = cpu->download(true), b = gpu->download(true);
    ASSERT_EQ(a.count, b.count);
    for (int g = 0; g < kNumGroups; ++g) {
        Difference d;
        for (std::size_t i = 0; i < a.groups[g].m.size(); ++i) {
            ASSERT_TRUE(std::isfinite(b.groups[g].m[i]) && std::isfinite(b.groups[g].param[i]));
            d.add(b.groups[g].m[i], a.groups[g].m[i]);
        }
        EXPECT_LE(d.worst, tolerance * d.scale) << kGroupNames[g];
        std::printf("%s: worst difference %.2e of %.2e\n", kGroupNames[g], d.worst, d.scale);
    }
    Difference stat;
    std::int64_t other = 0;
    for (std::int64_t i = 0; i < a.count; ++i) {
        stat.add(b.gradient_sum[i], a.gradient_sum[i]);
        other += a.gradient_count[i] != b.gradient_count[i];
    }
    // Tiles differ in size, so that an ellipse between pixel centres may touch a tile of one backend only.
    EXPECT_LE(other, 1 + a.count / 100);
    EXPECT_LE(stat.worst, tolerance * stat.scale);
}

TEST_F(Cuda, GradientsAgreeWithTheCpu) {
    expect_same_gradients(cast<float>(random_gaussians(100, 3, 2)), 33, 25, 3, false, 2e-4);
    expect_same_gradients(cast<float>(random_gaussians(3000, 3, 3)), 240, 130, 4, false, 1e-3);
    expect_same_gradients(cast<float>(random_gaussians(500, 3, 4)), 61, 47, 3, true, 1e-3);
    expect_same_gradients(cast<float>(random_gaussians(4, 3, 5)), 1, 1, 3, false, 2e-4);
}

TEST_F(Cuda, McmcMovesTheSameRowsAsTheCpu) {
    Gaussians s = cast<float>(random_gaussians(1000, 3, 7));
    for (int i = 0; i < 1000; i += 7) s[Group::kOpacity].param[i] = -9;
    s[Group::kRotation].param[44] = s[Group::kRotation].param[45] = s[Group::kRotation].param[46] = s[Group::kRotation].param[47] = 0;
    for (auto& g : s.groups) g.m.assign(g.param.size(), 1.0f), g.v.assign(g.param.size(), 2.0f);
    const auto cpu = make_cpu_backend(s.appearance), gpu = make_cuda_backend(s.appearance);
    cpu->upload(s), gpu->upload(s);
    McmcParams p;
    p.cap = 1100;
    for (int k = 0; k < 3; ++k) {
        const DensifyStats a = cpu->densify_mcmc(p, 600 + 100 * k, 3), b = gpu->densify_mcmc(p, 600 + 100 * k, 3);
        EXPECT_EQ(a.relocated, b.relocated);
        EXPECT_EQ(a.added, b.added);
        EXPECT_EQ(a.count, b.count);
    }
    const Gaussians a = cpu->download(true), b = gpu->download(true);
    EXPECT_EQ(a.count, 1100);
    for (int g = 0; g < kNumGroups; ++g) {
        EXPECT_EQ(a.groups[g].param, b.groups[g].param) << kGroupNames[g];
        EXPECT_EQ(a.groups[g].m, b.groups[g].m) << kGroupNames[g];
        EXPECT_EQ(a.groups[g].v, b.groups[g].v) << kGroupNames[g];
    }
}

TEST_F(Cuda, ExtremesStayFinite) {
    const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
    for (const double mean : {0.0, nan, inf, -inf, 1e30})
        for (const double scale : {-30.0, 0.0, 30.0, 60.0, nan})
            for (const double opacity : {-50.0, 0.0, 50.0, nan}) {
                auto d = random_gaussians(40, 3, 9);
                d[Group::kMean].param[4] = mean;
                for (int k = 6; k < 9; ++k) d[Group::kScale].param[k] = scale;
                d[Group::kOpacity].param[2] = opacity;
                const Gaussians s = cast<float>(d);
                const auto gpu = make_cuda_backend(s.appearance);
                gpu->upload(s);
                RenderRequest r;
                r.camera = cast<float>(test_camera(40, 30));
                RenderedImage image;
                gpu->render(r, image);
                for (float x : image.rgb) ASSERT_TRUE(std::isfinite(x)) << mean << " " << scale << " " << opacity;
                std::vector<std::uint8_t> target(40 * 30 * 3, 90);
                StepRequest step;
                step.camera = r.camera;
                step.target = {40, 30, 3, target.data(), nullptr, nullptr};
                for (double& rate : step.rates) rate = 1e-3;
                gpu->step(step);
                const Gaussians after = gpu->download(true);
                for (int g = 0; g < kNumGroups; ++g)
                    for (std::size_t i = 0; i < after.groups[g].m.size(); ++i)
                        if (std::isfinite(s.groups[g].param[i])) {
                            ASSERT_TRUE(std::isfinite(after.groups[g].m[i]) || g == int(Group::kScale) || g == int(Group::kOpacity)) << kGroupNames[g];
                        }
            }
}

}  // namespace
}  // namespace gs::test
