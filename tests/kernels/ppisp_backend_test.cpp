// SPDX-License-Identifier: Apache-2.0
// PPISP inside the CPU backend: what is corrected, what learns, and what it finds.
#include <gtest/gtest.h>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/ppisp/ppisp.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/random_scene.h"

namespace gs {
namespace {

constexpr int kWidth = 48, kHeight = 36, kFrames = 4;

/// Four frames of one scene, whose images differ by exposure.
struct Frames {
    Gaussians model = test::cast<float>(test::random_gaussians(60, 1, 3));
    std::vector<CameraParams<float>> cameras;
    std::vector<std::vector<float>> targets;  ///< (H,W,3)
    const float exposures[kFrames] = {0.5f, -0.4f, -0.3f, 0.2f};

    Frames() {
        for (auto& group : model.groups)
            group.m.assign(group.param.size(), 0.0f), group.v.assign(group.param.size(), 0.0f);
        for (float& x : model[Group::kBase].param) x -= 0.2f;  // below white, where an exposure shows
        model.ppisp = identity_ppisp(kFrames, 1);
        for (int f = 0; f < kFrames; ++f) model.ppisp.param[kIspFrameValues * f] = exposures[f];
        const auto backend = make_cpu_backend(model.appearance);
        backend->upload(model);
        for (int f = 0; f < kFrames; ++f) {
            cameras.push_back(test::cast<float>(test::test_camera(kWidth, kHeight)));
            cameras.back().translation.x += 0.2f * float(f);
            cameras.back().position = cameras.back().rotation.transposed_times(cameras.back().translation) * -1.0f;
            RenderedImage image;
            backend->render(request(f, IspMode::kFrame), image);
            std::vector<float> target(image.rgb.size());
            for (int i = 0; i < kWidth * kHeight; ++i)
                for (int c = 0; c < 3; ++c) target[3 * i + c] = image.rgb[c * kWidth * kHeight + i];
            targets.push_back(std::move(target));
        }
        model.ppisp = identity_ppisp(kFrames, 1);
    }
    RenderRequest request(int frame, IspMode mode) const {
        RenderRequest r;
        r.camera = cameras[frame], r.isp.mode = mode, r.isp.frame = frame;
        return r;
    }
    /// A step in which no Gaussian moves.
    StepRequest step(int frame, IspMode mode, double isp_rate) const {
        StepRequest r;
        r.camera = cameras[frame];
        r.target = {kWidth, kHeight, 3, nullptr, targets[frame].data(), nullptr, {}};
        r.loss.opacity_reg = r.loss.scale_reg = 0;
        r.isp.mode = mode, r.isp.frame = frame, r.rates.isp = isp_rate;
        return r;
    }
    std::unique_ptr<Backend> backend() const {
        auto b = make_cpu_backend(model.appearance);
        b->upload(model);
        return b;
    }
    std::vector<float> image(Backend& b, int frame, IspMode mode, RenderMode part = RenderMode::kFull) const {
        RenderedImage out;
        RenderRequest r = request(frame, mode);
        r.mode = part;
        b.render(r, out);
        return out.rgb;
    }
};

TEST(PpispBackend, FindsTheExposuresOfItsFrames) {
    const Frames frames;
    const auto backend = frames.backend();
    constexpr int kSteps = 1200;
    for (int i = 0; i < kSteps; ++i)
        backend->step(frames.step(i % kFrames, IspMode::kFrame, 0.02 * std::pow(0.005, i / double(kSteps))));
    EXPECT_LT(backend->take_stats().loss, 2e-3);
    const Gaussians after = backend->download(true);
    for (int f = 0; f < kFrames; ++f)
        EXPECT_NEAR(after.ppisp.param[kIspFrameValues * f], frames.exposures[f], 1e-3) << f;  // off by 5e-5 as measured
    EXPECT_EQ(after.ppisp.step, kSteps);
    EXPECT_EQ(after[Group::kBase].param, frames.model[Group::kBase].param);
}

TEST(PpispBackend, ControllerLearnsTheExposuresFromTheImages) {
    Frames frames;
    initialize_controller(frames.model.ppisp, 1);
    const auto backend = frames.backend();
    const auto mean_loss = [&] {
        double sum = 0;
        for (int f = 0; f < kFrames; ++f) {
            backend->distill(frames.step(f, IspMode::kController, 0));
            sum += backend->take_stats().loss / kFrames;
        }
        return sum;
    };
    const double before = mean_loss();
    for (int i = 0; i < 300; ++i) backend->distill(frames.step(i % kFrames, IspMode::kController, 0.001));
    EXPECT_LT(mean_loss(), 0.5 * before);  // 0.29 as measured, and falling
    const Gaussians after = backend->download(true);
    EXPECT_EQ(after.ppisp.param, frames.model.ppisp.param) << "frozen";
    EXPECT_EQ(after[Group::kMean].param, frames.model[Group::kMean].param);
    EXPECT_EQ(after.step, 0);
    EXPECT_EQ(after.ppisp.controller_step, 300);
    EXPECT_NE(after.ppisp.controller, frames.model.ppisp.controller);
}

TEST(PpispBackend, IsLeftOutWhereItIsNotAskedForOrNotThere) {
    Frames frames;
    frames.model.ppisp.param[0] = 1;
    const auto with = frames.backend();
    const auto raw = frames.image(*with, 0, IspMode::kNone);
    EXPECT_NE(frames.image(*with, 0, IspMode::kFrame), raw);
    // A residual is no colour; the base is.
    EXPECT_EQ(frames.image(*with, 0, IspMode::kFrame, RenderMode::kResidualOnly),
              frames.image(*with, 0, IspMode::kNone, RenderMode::kResidualOnly));
    EXPECT_NE(frames.image(*with, 0, IspMode::kFrame, RenderMode::kBaseOnly),
              frames.image(*with, 0, IspMode::kNone, RenderMode::kBaseOnly));
    with->step(frames.step(0, IspMode::kNone, 0.01));
    EXPECT_EQ(with->download(true).ppisp.param, frames.model.ppisp.param);
    for (const StageCost& cost : with->measure_stages({})) EXPECT_NE(cost.stage, "PPISP");
    with->step(frames.step(0, IspMode::kFrame, 0));
    EXPECT_EQ(with->download(true).ppisp.param, frames.model.ppisp.param) << "frozen";
    EXPECT_EQ(with->download(true).ppisp.step, 0);
    EXPECT_EQ(with->measure_stages({}).back().stage, "PPISP");
    with->upload_ppisp({});
    EXPECT_EQ(frames.image(*with, 0, IspMode::kFrame), raw);
    with->step(frames.step(0, IspMode::kFrame, 0.01));
}

TEST(PpispBackend, KnownAndUnknownFramesAndControllers) {
    Frames frames;
    frames.model.ppisp.param[0] = 1;
    frames.model.ppisp.param[frames.model.ppisp.camera_offset(0) + 2] = -0.5f;  // vignetting
    const auto backend = frames.backend();
    // Without a controller: neutral, as an unknown frame, with the camera's vignetting.
    RenderRequest unknown = frames.request(0, IspMode::kFrame);
    unknown.isp.frame = -1;
    RenderedImage neutral;
    backend->render(unknown, neutral);
    EXPECT_EQ(frames.image(*backend, 0, IspMode::kController), neutral.rgb);
    EXPECT_NE(neutral.rgb, frames.image(*backend, 0, IspMode::kNone));
    // A controller whose last layer only has biases says the same of every image: what frame 0 has.
    initialize_controller(frames.model.ppisp, 1);
    const ControllerLayer heads = controller_layer(6);
    std::fill(frames.model.ppisp.controller.begin() + heads.offset, frames.model.ppisp.controller.end(), 0.0f);
    frames.model.ppisp.controller[heads.bias()] = 1;
    backend->upload_ppisp(frames.model.ppisp);
    EXPECT_EQ(frames.image(*backend, 0, IspMode::kController), frames.image(*backend, 0, IspMode::kFrame));
}

TEST(PpispBackend, UnknownIndicesAreNamed) {
    Frames frames;
    const auto backend = frames.backend();
    const auto message = [&](const RenderRequest& r) -> std::string {
        RenderedImage out;
        try {
            backend->render(r, out);
        } catch (const UsageError& e) {
            return e.what();
        }
        return "";
    };
    RenderRequest r = frames.request(0, IspMode::kFrame);
    r.isp.frame = kFrames;
    EXPECT_NE(message(r).find("frame 4"), std::string::npos) << message(r);
    r.isp.frame = -2;
    EXPECT_NE(message(r).find("frame -2"), std::string::npos);
    r.isp.frame = 0, r.isp.camera = 1;
    EXPECT_NE(message(r).find("camera 1"), std::string::npos);
    r.isp.mode = IspMode::kNone;
    EXPECT_EQ(message(r), "");
    EXPECT_THROW(backend->distill(frames.step(0, IspMode::kController, 0.1)), UsageError) << "there is no controller";
}

TEST(PpispBackend, GaussiansLearnThroughTheCorrection) {
    // Targets are made with known exposures, which the frozen PPISP has: the Gaussians find back to their colours.
    Frames frames;
    for (int f = 0; f < kFrames; ++f) frames.model.ppisp.param[kIspFrameValues * f] = frames.exposures[f];
    const auto want = frames.model[Group::kBase].param;
    for (float& x : frames.model[Group::kBase].param) x += 0.1f;
    const auto backend = frames.backend();
    backend->step(frames.step(0, IspMode::kFrame, 0));
    const double before = backend->take_stats().loss;
    for (int i = 0; i < 400; ++i) {
        StepRequest r = frames.step(i % kFrames, IspMode::kFrame, 0);
        r.rates.groups[int(Group::kBase)] = 0.01 * std::pow(0.02, i / 400.0);
        backend->step(r);
    }
    EXPECT_LT(backend->take_stats().loss, 0.05 * before);
}

TEST(ViewCorrection, ANonFiniteGradientLeavesEverythingAsItIs) {
    PpispState state = identity_ppisp(2, 1);
    initialize_controller(state, 1);
    allocate_moments(state);
    const PpispState before = state;
    std::vector<float> image(3 * 6 * 6, 0.5f), out(image.size()), gradient(image.size(), 0.1f);
    gradient[7] = std::nanf("");
    for (const IspMode mode : {IspMode::kFrame, IspMode::kController}) {
        ViewCorrection correction;
        correction.apply(state, {mode, 0, 0, 0}, image.data(), 6, 6, out.data());
        auto g = gradient;
        correction.backward(image.data(), g.data());
        ++state.step, ++state.controller_step;
        EXPECT_FALSE(mode == IspMode::kFrame ? correction.step_parameters(state, 0.1)
                                             : correction.step_controller(state, image.data(), 0.1));
    }
    EXPECT_EQ(state.param, before.param);
    EXPECT_EQ(state.m, before.m);
    EXPECT_EQ(state.v, before.v);
    EXPECT_EQ(state.controller, before.controller);
    EXPECT_EQ(state.controller_m, before.controller_m);
}

TEST(ViewCorrection, AnImageTooSmallLeavesTheController) {
    PpispState state = identity_ppisp(1, 1);
    initialize_controller(state, 1);
    allocate_moments(state);
    state.controller_m.assign(state.controller.size(), 0.5f);  // Adam would move with it
    const auto before = state.controller;
    std::vector<float> image(3 * 2 * 9, 0.5f), out(image.size()), gradient(image.size(), 0.1f);
    ViewCorrection correction;
    correction.apply(state, {IspMode::kController, -1, 0, 0}, image.data(), 2, 9, out.data());
    correction.backward(image.data(), gradient.data());
    state.controller_step = 1;
    EXPECT_TRUE(correction.step_controller(state, image.data(), 0.1));
    EXPECT_EQ(state.controller, before);
}

TEST(ViewCorrection, IsIndependentOfTheNumberOfThreads) {
    const int w = 130, h = 77;
    std::vector<float> out[2], gradient[2], param[2];
    for (int k = 0; k < 2; ++k) {
        set_num_threads(k ? 3 : 1);
        PpispState state = identity_ppisp(3, 2);
        allocate_moments(state);
        state.step = 1;
        const auto random = test::random_weights(3 * w * h, 5);
        std::vector<float> image(random.begin(), random.end());
        out[k] = image, gradient[k] = image;
        ViewCorrection correction;
        correction.apply(state, {IspMode::kFrame, 1, 1, 0}, image.data(), w, h, out[k].data());
        correction.backward(image.data(), gradient[k].data());
        EXPECT_TRUE(correction.step_parameters(state, 0.01));
        param[k] = state.param;
    }
    set_num_threads(0);
    EXPECT_EQ(out[0], out[1]);
    EXPECT_EQ(gradient[0], gradient[1]);
    EXPECT_EQ(param[0], param[1]);
}

}  // namespace
}  // namespace gs
