// SPDX-License-Identifier: Apache-2.0
// More instances than there is room for, and more than there may ever be. Skipped where there is no device.

#include "kernels/base/error.h"
#include "tests/gpu/gpu_test.h"
#include "tests/gpu/scenes.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

class GpuCapacity : public Gpu {
  protected:
    /// Returns the message of the DeviceError that `call` must throw.
    template <class Call> static std::string device_error(Call&& call) {
        try {
            call();
        } catch (const DeviceError& e) {
            return e.what();
        }
        ADD_FAILURE() << "no DeviceError";
        return "";
    }
    static void expect_too_many_instances(const std::string& message) {
        for (const char* part : {"2147483647", "instances", "--cap-max", "--resolution"})
            EXPECT_NE(message.find(part), std::string::npos) << message;
    }
};

/// 8192x8192 pixels are 512 x 683 = 349 696 tiles. More than 2^31 / 349 696 = 6141 Gaussians that cover them all are
/// too many.
TEST_F(GpuCapacity, MoreThanTwoToThe31InstancesAreRefused) {
    auto s = random_gaussians(7000, 0, 3);
    std::fill(s[Group::kScale].param.begin(), s[Group::kScale].param.end(), 4.0);
    std::fill(s[Group::kOpacity].param.begin(), s[Group::kOpacity].param.end(), 0.0);
    const Gaussians model = float_model(s);
    const auto gpu = make_cuda_backend(model.appearance);
    gpu->upload(model);
    RenderRequest large, small;
    large.camera = cast<float>(test_camera(8192, 8192)), small.camera = cast<float>(test_camera(32, 24));
    RenderedImage image;
    const std::string refusal = device_error([&] { gpu->render(large, image); });
    expect_too_many_instances(refusal);
    std::printf("  %s\n", refusal.c_str());

    // Nothing is lost, and the backend goes on.
    expect_same_bits(gpu->download(false), model);
    RenderedImage expected;
    const auto cpu = make_cpu_backend(model.appearance);
    cpu->upload(model);
    cpu->render(small, expected), gpu->render(small, image);
    ASSERT_EQ(image.rgb.size(), expected.rgb.size());
    for (std::size_t i = 0; i < image.rgb.size(); ++i) ASSERT_NEAR(image.rgb[i], expected.rgb[i], 1e-3);

    // A step is refused, too, when its count is known.
    const RandomTarget large_target(8192, 8192, 3), small_target(32, 24, 3);
    expect_too_many_instances(device_error([&] {
        gpu->step(step_request(large.camera, large_target.image()));
        gpu->synchronize();
    }));
    const Gaussians after = gpu->download(true);
    for (int g = 0; g < kNumGroups; ++g) {
        EXPECT_TRUE(same_bits(after.groups[g].param, model.groups[g].param)) << kGroupNames[g];
        EXPECT_EQ(after.groups[g].m, std::vector<float>(after.groups[g].m.size())) << kGroupNames[g];
    }
    gpu->take_stats();
    gpu->step(step_request(small.camera, small_target.image()));
    gpu->synchronize();
    EXPECT_EQ(gpu->take_stats().steps, 1);
    EXPECT_NE(gpu->download(false)[Group::kMean].param, model[Group::kMean].param);
}

/// Steps through views with few and with a hundred times more instances. Several are under way before the host learns
/// that one did not fit. The data that a step points to is overwritten as soon as it returns.
TEST_F(GpuCapacity, StepsThatDidNotFitAreRepeated) {
    const TestScene scene = random_scene(3000, 3, 640, 480, -0.5, 5);
    const CameraParams<float> few = cast<float>(test_camera(48, 36)), many = scene.camera;
    constexpr std::int64_t kFirstRoom = 65536;  // what a backend has room for at first
    for (const char* order : {"fmfm", "mfmf", "ffmmmmff", "fffffmf"}) {
        SCOPED_TRACE(order);
        Gaussians after[2];
        double losses[2];
        for (const bool room : {false, true}) {
            const auto gpu = make_cuda_backend(scene.model.appearance, {.deterministic = true});
            gpu->upload(scene.model);
            RenderedImage image;
            if (room) gpu->render({many, {}, RenderMode::kFull}, image);
            RandomTarget small(48, 36, 3), large(640, 480, 3);
            int k = 0;
            for (const char* view = order; *view; ++view, ++k) {
                RandomTarget& target = *view == 'f' ? small : large;
                StepRequest r = step_request(*view == 'f' ? few : many, target.image());
                r.iteration = k, r.rates.noise = 80, r.seed = 1;
                gpu->step(r);
                for (auto& x : target.u8) x = std::uint8_t(x * 5 + 1 + k);
            }
            gpu->synchronize();
            const StepStats stats = gpu->take_stats();
            EXPECT_EQ(stats.steps, k);
            losses[room] = stats.loss;
            if (order[k - 1] == 'm') {
                EXPECT_GT(stats.num_instances, 2 * kFirstRoom) << "the test needs a view that does not fit";
            } else {
                EXPECT_LT(stats.num_instances, kFirstRoom);
            }
            after[room] = gpu->download(true);
        }
        EXPECT_EQ(losses[0], losses[1]);
        expect_same_bits(after[0], after[1]);
    }
}

/// Rendering makes room, too, and the first image is already whole.
TEST_F(GpuCapacity, AnImageThatDidNotFitIsRenderedAgain) {
    const TestScene scene = random_scene(3000, 3, 640, 480, -0.5, 5);
    const auto first = make_cuda_backend(scene.model.appearance), second = make_cuda_backend(scene.model.appearance);
    first->upload(scene.model), second->upload(scene.model);
    RenderedImage a, b, small;
    RenderRequest r;
    r.camera = scene.camera;
    first->render(r, a);
    second->render(r, b), second->render({cast<float>(test_camera(48, 36)), {}, RenderMode::kFull}, small),
        second->render(r, b);
    EXPECT_TRUE(same_bits(a.rgb, b.rgb));
    EXPECT_TRUE(same_bits(a.alpha, b.alpha));
}

// A device that answers runs a first kernel of this build, and says what it is.

TEST_F(Gpu, RunsAFirstKernelOfThisBuildAndIsAvailableAfterIt) {
    EXPECT_EQ(try_cuda_device(), "");
    EXPECT_TRUE(cuda_available()) << cuda_unavailable_reason();
    EXPECT_GT(cuda_device_count(), 0);
    EXPECT_NE(cuda_driver_description().find("(sm_"), std::string::npos) << cuda_driver_description();
}

}  // namespace
}  // namespace gs::test
