// SPDX-License-Identifier: Apache-2.0
// A device whose memory is full: the error names what was asked for and what helps, nothing is lost, and training goes
// on. Skipped where there is no device.
#include "kernels/base/error.h"
#include "tests/gpu/out_of_memory/device_hog.h"
#include "tests/gpu/scenes.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

constexpr std::size_t kLeft = std::size_t(200) << 20;

class GpuOutOfMemory : public Gpu {
  protected:
    const TestScene scene_ = random_scene(2000, 3, 64, 48, -1, 8);
    const RandomTarget target_{64, 48, 3};
    std::unique_ptr<Backend> make() const {
        auto gpu = make_cuda_backend(scene_.model.appearance, {.deterministic = true});
        gpu->upload(scene_.model);
        return gpu;
    }
    void small_steps(Backend& gpu, int n) const {
        for (int k = 0; k < n; ++k) gpu.step(step_request(scene_.camera, target_.image(1)));
    }
    static void expect_out_of_memory(Backend& gpu, const StepRequest& r) {
        try {
            gpu.step(r);
            gpu.synchronize();
            FAIL() << "a step of " << r.camera.width << "x" << r.camera.height << " pixels in " << (kLeft >> 20)
                   << " MiB";
        } catch (const DeviceError& e) {
            const std::string message = e.what();
            std::printf("  %s\n", e.what());
            for (const char* part :
                 {"out of device memory", "asked for", "free", "--cap-max", "--resolution", "--image-cache"})
                EXPECT_NE(message.find(part), std::string::npos) << message;
        }
    }
};

/// A step needs 64 bytes a pixel, 1 GiB here.
TEST_F(GpuOutOfMemory, AStepThatDoesNotFitLeavesTheModelAsItWas) {
    const auto gpu = make(), untouched = make();
    small_steps(*gpu, 5), small_steps(*untouched, 5);
    const Gaussians before = gpu->download(true);
    const RandomTarget huge(4096, 4096, 3);
    const StepRequest too_large = step_request(cast<float>(test_camera(4096, 4096)), huge.image());
    DeviceHog hog(kLeft);
    ASSERT_LT(DeviceHog::free_bytes(), 2 * kLeft);
    expect_out_of_memory(*gpu, too_large);
    expect_same_bits(gpu->download(true), before);
    // Steps already under way are done.
    small_steps(*gpu, 2), small_steps(*untouched, 2);
    expect_out_of_memory(*gpu, too_large);
    expect_same_bits(gpu->download(true), untouched->download(true));

    hog.release();
    small_steps(*gpu, 3), small_steps(*untouched, 3);
    expect_same_bits(gpu->download(true), untouched->download(true));
    gpu->synchronize();
    gpu->take_stats();
    gpu->step(too_large);
    gpu->synchronize();
    EXPECT_EQ(gpu->take_stats().steps, 1);
}

/// The image of 10 000 x 10 000 pixels of 3 bytes alone takes 286 MiB, before anything else is asked for.
TEST_F(GpuOutOfMemory, AnImageThatDoesNotFitIsNotRememberedAsKept) {
    const auto gpu = make();
    small_steps(*gpu, 2);
    const RandomTarget huge(10000, 10000, 3);
    const StepRequest too_large = step_request(cast<float>(test_camera(10000, 10000)), huge.image(77));
    DeviceHog hog(kLeft);
    expect_out_of_memory(*gpu, too_large);
    hog.release();
    gpu->synchronize();
    gpu->take_stats();
    gpu->step(too_large);
    gpu->synchronize();
    const StepStats stats = gpu->take_stats();
    EXPECT_EQ(stats.steps, 1);
    EXPECT_TRUE(stats.loss > 0.05 && stats.loss < 1) << stats.loss;
}

TEST_F(GpuOutOfMemory, RenderingAndGrowingFailTheSameWay) {
    const auto gpu = make();
    small_steps(*gpu, 2);
    const Gaussians before = gpu->download(true);
    DeviceHog hog(kLeft);
    RenderedImage image;
    RenderRequest r;
    r.camera = cast<float>(test_camera(8192, 8192));
    EXPECT_THROW(gpu->render(r, image), DeviceError);
    // A million Gaussians of 59 values in three copies: 675 MiB.
    EXPECT_THROW(gpu->upload(cast<float>(random_gaussians(1000000, 3, 1))), DeviceError);
    hog.release();
    gpu->upload(before);
    small_steps(*gpu, 2);
    const auto other = make();
    small_steps(*other, 4);
    expect_same_bits(gpu->download(true), other->download(true));
}

}  // namespace
}  // namespace gs::test
