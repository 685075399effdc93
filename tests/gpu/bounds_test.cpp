// SPDX-License-Identifier: Apache-2.0
// The error bounds of the GPU tests, on the CPU: they hold for the float backend, and they notice mistakes. Needs no
// device.
#include "tests/gpu/agreement.h"
#include "tests/kernels/backends.h"

namespace gs::test {
namespace {

/// Returns the scenes that take the CPU about a second, and a strip as wide as the largest.
std::vector<NamedScene> small_scenes() {
    std::vector<NamedScene> scenes = test_scenes();
    std::erase_if(scenes, [](const NamedScene& s) { return s.is_large; });
    scenes.push_back({"Wide", [] { return random_scene(60, 3, 3840, 32, -1, 4); }});
    return scenes;
}

class Bounds : public ::testing::TestWithParam<NamedScene> {};
INSTANTIATE_TEST_SUITE_P(Scenes, Bounds, ::testing::ValuesIn(small_scenes()), scene_name);

TEST_P(Bounds, HoldForTheCpuInFloat) {
    const TestScene scene = GetParam().make();
    const auto cpu = make_cpu_backend(scene.model.appearance);
    expect_images_within_bounds(*cpu, scene);
    expect_step_within_bounds({cpu.get()}, scene);
}

// Bounds that are never reached would let everything pass. Opacities off by less than a thousandth must show in many
// pixels and gradients.
TEST(Bounds, NoticeASmallMistake) {
    const TestScene scene = random_scene(60, 3, 64, 48, -0.5, 2);
    TestScene wrong = scene;
    for (float& x : wrong.model[Group::kOpacity].param) x += 2e-3f;
    const auto share_beyond = [](const std::vector<Rounded>& right, const std::vector<Rounded>& other) {
        std::size_t beyond = 0;
        for (std::size_t i = 0; i < right.size(); ++i) beyond += std::abs(other[i].v - right[i].v) > right[i].e;
        return double(beyond) / double(right.size());
    };
    const RenderRequest image{scene.camera, scene.background, RenderMode::kFull};
    EXPECT_GT(share_beyond(reference_render(scene.model, image).rgb, reference_render(wrong.model, image).rgb), 0.1);
    const RandomTarget target(64, 48, 3);
    const StepRequest step = step_request(scene.camera, target.image());
    const StepReference a = reference_step(scene.model, step), b = reference_step(wrong.model, step);
    for (int g = 0; g < kNumGroups; ++g) EXPECT_GT(share_beyond(a.gradient[g], b.gradient[g]), 0.1) << kGroupNames[g];
    EXPECT_GT(share_beyond(a.statistic, b.statistic), 0.1);
}

}  // namespace
}  // namespace gs::test
