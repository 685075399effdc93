// SPDX-License-Identifier: Apache-2.0
// Medians of pixels on the device against the reference in double. Skipped where there is no device.
#include "kernels/reference_image.h"
#include "tests/gpu/scenes.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

class GpuMedian : public Gpu, public ::testing::WithParamInterface<NamedScene> {};
INSTANTIATE_TEST_SUITE_P(Scenes, GpuMedian, ::testing::ValuesIn(test_scenes()), scene_name);

/// Rounding decides which Gaussian it is where transmittance is about 1/2 beside one. The CPU in float has the same
/// roundings, so its share of such pixels says how many there may be.
std::size_t num_other(const std::vector<double>& expected, const std::vector<float>& image) {
    const std::size_t plane = image.size() / 3;
    std::size_t other = 0;
    for (std::size_t i = 0; i < plane; ++i) {
        bool differs = false;
        for (std::size_t k = i; k < image.size(); k += plane) differs |= !(std::abs(expected[k] - image[k]) < 1e-4);
        other += differs;
    }
    return other;
}

TEST_P(GpuMedian, IsTheOneOfTheReference) {
    const TestScene scene = GetParam().make();
    RenderRequest request;
    request.camera = scene.camera, request.background = scene.background, request.median = true;
    const std::vector<double> expected = render_in_double(scene.model, request);
    RenderedImage image;
    const auto cpu = make_cpu_backend(scene.model.appearance);
    cpu->upload(scene.model);
    cpu->render(request, image);
    const std::size_t on_cpu = num_other(expected, image.rgb), plane = image.alpha.size();
    for (const bool deterministic : {false, true}) {
        const auto gpu = make_cuda_backend(scene.model.appearance, {.deterministic = deterministic});
        gpu->upload(scene.model);
        gpu->render(request, image);
        const std::size_t other = num_other(expected, image.rgb);
        std::printf("  %zu of %zu pixels show another Gaussian, on the CPU %zu\n", other, plane, on_cpu);
        EXPECT_LE(other, 4 * on_cpu + 1 + plane / 1000);
        RenderedImage plain;
        request.median = false;
        gpu->render(request, plain);
        request.median = true;
        EXPECT_TRUE(same_bits(image.alpha, plain.alpha));
    }
}

}  // namespace
}  // namespace gs::test
