// SPDX-License-Identifier: Apache-2.0
// PPISP and its controllers on the device against the CPU's and against double. Skipped where there is no device.
#include "kernels/ppisp/ppisp.h"
#include "tests/gpu/scenes.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

constexpr int kFrames = 7, kCameras = 2;

/// Returns values like those of a training, made of noise.
PpispState random_ppisp(std::uint32_t seed, bool with_controllers) {
    PpispState state = identity_ppisp(kFrames, kCameras);
    std::mt19937 rng(seed);
    std::normal_distribution<float> normal;
    for (int i = 0; i < kFrames * kIspFrameValues; ++i)
        state.param[i] = (i % kIspFrameValues ? 0.6f : 0.7f) * normal(rng);
    for (int c = 0; c < kCameras; ++c) {
        float* camera = state.param.data() + state.camera_offset(c);
        for (int k = 0; k < 3 * kIspVignetting; ++k)
            camera[k] = k % kIspVignetting < 2 ? 0.05f * normal(rng) : -0.2f * std::abs(normal(rng));
        for (int k = 3 * kIspVignetting; k < kIspCameraValues; ++k) camera[k] += 0.4f * normal(rng);
    }
    if (with_controllers) initialize_controller(state, seed);
    return state;
}

/// A backend on the device and one on the CPU with the same model.
struct Pair {
    TestScene scene;
    std::unique_ptr<Backend> gpu, cpu;

    Pair(TestScene s, const PpispState& ppisp, bool deterministic = false) : scene(std::move(s)) {
        scene.model.ppisp = ppisp;
        gpu = make_cuda_backend(scene.model.appearance, {.deterministic = deterministic});
        cpu = make_cpu_backend(scene.model.appearance);
        gpu->upload(scene.model), cpu->upload(scene.model);
    }
    RenderedImage render(const IspView& isp, RenderMode mode = RenderMode::kFull) const {
        RenderedImage image;
        gpu->render({scene.camera, scene.background, mode, isp}, image);
        return image;
    }
};

TestScene view_of(int width, int height) { return random_scene(400, 1, width, height, -0.5, 9); }

/// Returns the largest difference of two gradients over the largest value. The gradients are Adam's first moments of a
/// first step.
double difference(const std::vector<float>& a, const std::vector<float>& b, std::size_t begin, std::size_t end) {
    double largest = 0, error = 0;
    for (std::size_t i = begin; i < end; ++i)
        largest = std::max(largest, std::abs(double(b[i]))), error = std::max(error, std::abs(double(a[i]) - b[i]));
    return largest > 0 ? error / largest : error;
}

class GpuPpisp : public Gpu {};

TEST_F(GpuPpisp, CorrectsImagesAsTheCpuDoes) {
    for (const auto& [width, height] : {std::pair{133, 90}, {1, 1}, {2, 3}, {17, 4}, {3, 3}, {64, 800}}) {
        SCOPED_TRACE(testing::Message() << width << "x" << height);
        const Pair both(view_of(width, height), random_ppisp(3, true));
        const RenderedImage raw = both.render({});
        ViewCorrection correction;
        for (const IspView& view :
             {IspView{IspMode::kFrame, 4, 1, 0}, IspView{IspMode::kFrame, -1, 0, 0},
              IspView{IspMode::kController, -1, 0, 0.5f}, IspView{IspMode::kController, 2, 1, -1.0f}}) {
            std::vector<float> expected(raw.rgb.size());
            correction.apply(both.scene.model.ppisp, view, raw.rgb.data(), width, height, expected.data());
            const RenderedImage image = both.render(view);
            double error = 0;
            for (std::size_t i = 0; i < expected.size(); ++i)
                error = std::max(error, double(std::abs(image.rgb[i] - expected[i])));
            EXPECT_LT(error, 1e-5) << "mode " << int(view.mode);
            EXPECT_EQ(image.alpha, raw.alpha);
        }
        EXPECT_TRUE(same_bits(both.render({IspMode::kFrame, 4, 1, 0}, RenderMode::kResidualOnly).rgb,
                              both.render({}, RenderMode::kResidualOnly).rgb));
    }
}

TEST_F(GpuPpisp, ChangesNoPixelOfEightBitsToBeginWith) {
    const Pair both(view_of(133, 90), identity_ppisp(kFrames, kCameras));
    const RenderedImage raw = both.render({}), image = both.render({IspMode::kFrame, 0, 0, 0});
    const auto byte = [](float x) { return int(std::clamp(x, 0.0f, 1.0f) * 255 + 0.5f); };
    std::size_t changed = 0;
    for (std::size_t i = 0; i < raw.rgb.size(); ++i) changed += byte(raw.rgb[i]) != byte(image.rgb[i]);
    EXPECT_EQ(changed, 0u);
}

TEST_F(GpuPpisp, ControllersSayWhatTheySayInDouble) {
    const PpispState state = random_ppisp(3, true);
    const Pair both(view_of(133, 90), state);
    const RenderedImage raw = both.render({});
    const std::vector<double> weights(state.controller.begin() + kControllerWeights, state.controller.end()),
        image(raw.rgb.begin(), raw.rgb.end());
    double said[kIspFrameValues];
    Controller<double>().forward(weights.data(), image.data(), 133, 90, 0.25, said);
    // Its values become those of a frame, whose picture must then be the same.
    PpispState as_frame = state;
    for (int k = 0; k < kIspFrameValues; ++k) as_frame.param[k] = float(said[k]);
    const RenderedImage of_controller = both.render({IspMode::kController, -1, 1, 0.25f});
    both.gpu->upload_ppisp(as_frame);
    const RenderedImage of_frame = both.render({IspMode::kFrame, 0, 1, 0});
    for (std::size_t i = 0; i < of_frame.rgb.size(); ++i) ASSERT_NEAR(of_controller.rgb[i], of_frame.rgb[i], 2e-6);
}

TEST_F(GpuPpisp, LearnsAsTheCpuDoes) {
    for (const auto& [width, height] : {std::pair{133, 90}, {1, 1}, {700, 5}}) {
        SCOPED_TRACE(testing::Message() << width << "x" << height);
        Pair both(view_of(width, height), random_ppisp(5, false));
        const RandomTarget target(width, height, 3);
        StepRequest r = step_request(both.scene.camera, target.image());
        r.isp = {IspMode::kFrame, 3, 1, 0}, r.rates.isp = 0.002;
        both.gpu->step(r), both.cpu->step(r);
        both.gpu->synchronize();
        EXPECT_NEAR(both.gpu->take_stats().loss, both.cpu->take_stats().loss, 1e-5);
        const Gaussians gpu = both.gpu->download(true), cpu = both.cpu->download(true);
        EXPECT_EQ(gpu.ppisp.step, 1);
        const PpispState& state = cpu.ppisp;
        const double frames = difference(gpu.ppisp.m, state.m, 0, state.camera_offset(0)),
                     cameras = difference(gpu.ppisp.m, state.m, state.camera_offset(0), state.size());
        const double means = difference(gpu[Group::kMean].m, cpu[Group::kMean].m, 0, cpu[Group::kMean].m.size());
        std::printf("  %dx%d: relative difference of the gradient, frames %.1e, cameras %.1e, means %.1e\n", width,
                    height, frames, cameras, means);
        EXPECT_LT(frames, 2e-4);
        EXPECT_LT(cameras, 2e-4);
        EXPECT_LT(means, 2e-3);
        // Rate 0 leaves all of it as it is.
        r.rates.isp = 0;
        both.gpu->step(r);
        EXPECT_TRUE(same_bits(both.gpu->download(true).ppisp.param, gpu.ppisp.param));
    }
}

TEST_F(GpuPpisp, ControllersLearnAsOnTheCpu) {
    for (const auto& [width, height] : {std::pair{133, 90}, {17, 4}, {250, 31}}) {
        SCOPED_TRACE(testing::Message() << width << "x" << height);
        Pair both(view_of(width, height), random_ppisp(6, true));
        const RandomTarget target(width, height, 3);
        StepRequest r = step_request(both.scene.camera, target.image());
        r.isp = {IspMode::kController, 3, 1, 0.5f}, r.rates.isp = 0.001;
        both.gpu->distill(r), both.cpu->distill(r);
        const Gaussians gpu = both.gpu->download(true), cpu = both.cpu->download(true);
        EXPECT_TRUE(same_bits(gpu[Group::kMean].param, both.scene.model[Group::kMean].param));
        EXPECT_TRUE(same_bits(gpu.ppisp.param, both.scene.model.ppisp.param));
        for (int layer = 0; layer < kControllerLayers; ++layer) {
            const std::size_t begin = kControllerWeights + controller_layer(layer).offset;
            const std::size_t end =
                kControllerWeights + controller_layer(layer).bias() + controller_layer(layer).outputs;
            const double error = difference(gpu.ppisp.controller_m, cpu.ppisp.controller_m, begin, end);
            std::printf("  %dx%d, layer %d: relative difference of the gradient %.1e\n", width, height, layer, error);
            EXPECT_LT(error, 2e-3) << "layer " << layer;
        }
        for (int k = 0; k < kControllerWeights; ++k)
            ASSERT_EQ(gpu.ppisp.controller_m[k], 0) << "another camera's controller";
    }
}

TEST_F(GpuPpisp, DistillationFindsTheExposure) {
    PpispState state = identity_ppisp(1, 1);
    initialize_controller(state, 1);
    Pair both(view_of(120, 90), state);
    const RenderedImage raw = both.render({});
    RandomTarget target(120, 90, 3, false, true);
    const std::size_t pixels = raw.alpha.size();
    for (std::size_t i = 0; i < pixels; ++i)
        for (std::size_t c = 0; c < 3; ++c) target.f32[3 * i + c] = std::min(1.0f, 0.5f * raw.rgb[c * pixels + i]);
    StepRequest r = step_request(both.scene.camera, target.image());
    r.background = both.scene.background;
    r.isp = {IspMode::kController, -1, 0, 0}, r.rates.isp = 0.001;
    both.gpu->distill(r);
    both.gpu->synchronize();
    const double before = both.gpu->take_stats().loss;
    for (int k = 0; k < 200; ++k) both.gpu->distill(r);
    both.gpu->synchronize();
    const double after = both.gpu->take_stats().loss;
    std::printf("  loss %.4f before, %.4f after 200 steps\n", before, after);
    EXPECT_LT(after, 0.1 * before);
}

TEST_F(GpuPpisp, StepsThatDidNotFitAreRepeated) {
    const TestScene scene = random_scene(3000, 1, 640, 480, -0.5, 5);
    const CameraParams<float> few = cast<float>(test_camera(48, 36));
    const RandomTarget small(48, 36, 3), large(640, 480, 3);
    PpispState after[2];
    for (const bool room : {false, true}) {
        Pair both(scene, random_ppisp(7, false), true);
        if (room) both.render({});
        for (int k = 0; k < 6; ++k) {
            StepRequest r = step_request(k % 2 ? both.scene.camera : few, (k % 2 ? large : small).image());
            r.isp = {IspMode::kFrame, k, k % 2, 0}, r.rates.isp = 0.002;
            both.gpu->step(r);
        }
        after[room] = both.gpu->download(true).ppisp;
    }
    EXPECT_EQ(after[0].step, 6);
    EXPECT_EQ(after[1].step, 6);
    EXPECT_TRUE(same_bits(after[0].param, after[1].param));
    EXPECT_TRUE(same_bits(after[0].m, after[1].m));
}

TEST_F(GpuPpisp, StaysFiniteAtTheExtremes) {
    for (const float extreme : {-1e30f, -1e4f, -20.0f, 20.0f, 1e4f, 1e30f}) {
        SCOPED_TRACE(extreme);
        PpispState state = random_ppisp(8, true);
        std::fill(state.param.begin(), state.param.end(), extreme);
        Pair both(view_of(40, 30), state);
        const RandomTarget target(40, 30, 3);
        StepRequest r = step_request(both.scene.camera, target.image());
        r.isp = {IspMode::kFrame, 3, 1, 0}, r.rates.isp = 0.002;
        expect_finite(both.render(r.isp).rgb, "pixel");
        both.gpu->step(r);
        const Gaussians after = both.gpu->download(true);
        expect_finite(after.ppisp.param, "parameter"), expect_finite(after.ppisp.m, "moment");
        for (int g = 0; g < kNumGroups; ++g) expect_finite(after.groups[g].m, kGroupNames[g]);
        r.isp.mode = IspMode::kController, r.rates.isp = 0.001;
        both.gpu->distill(r);
        expect_finite(both.gpu->download(true).ppisp.controller, "weight");
    }
}

TEST_F(GpuPpisp, RefusesViewsThatTheModelDoesNotHave) {
    const Pair both(view_of(40, 30), random_ppisp(9, false));
    EXPECT_THROW(both.render({IspMode::kFrame, kFrames, 0, 0}), UsageError);
    EXPECT_THROW(both.render({IspMode::kFrame, 0, kCameras, 0}), UsageError);
    const RandomTarget target(40, 30, 3);
    StepRequest r = step_request(both.scene.camera, target.image());
    r.isp = {IspMode::kController, -1, 0, 0}, r.rates.isp = 0.001;
    EXPECT_THROW(both.gpu->distill(r), UsageError) << "there is no controller";
    r.isp = {IspMode::kFrame, kFrames, 0, 0};
    EXPECT_THROW(both.gpu->step(r), UsageError);
    r.isp = {IspMode::kFrame, 0, 0, 0};  // the backend goes on
    both.gpu->step(r);
    EXPECT_EQ(both.gpu->download(false).step, 1);
}

TEST_F(GpuPpisp, IsNotPaidForByAModelWithoutIt) {
    const Pair with(view_of(40, 30), random_ppisp(9, false)), without(view_of(40, 30), {});
    EXPECT_TRUE(same_bits(without.render({IspMode::kFrame, 3, 1, 0}).rgb, without.render({}).rgb));
    for (const auto& row : without.gpu->memory().rows) EXPECT_NE(row.what, "PPISP");
    EXPECT_TRUE(same_bits(with.render({}).rgb, without.render({}).rgb));
}

}  // namespace
}  // namespace gs::test
