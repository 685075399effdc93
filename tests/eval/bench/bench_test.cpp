// SPDX-License-Identifier: Apache-2.0
// What is measured, in which order, and what the reader is told; and the generated sets.
#include "eval/bench/bench.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "eval/bench/bench_cases.h"
#include "eval/bench/frame_times.h"
#include "eval/metrics/quantize.h"
#include "kernels/base/parallel.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/resized.h"
#include "tests/eval/support/fake_engine.h"
#include "tests/kernels/forwarding_engine.h"

namespace gs {
namespace {

const AppearanceSpec kSh{"sh", 3, ColorActivation::kRelu};

TrainOptions some_options() {
    TrainOptions options;
    options.source = "generated";
    options.background = {.color = {0, 0, 1}};
    options = resolve(options);
    return options;
}

/// Returns generated views of 24x16 pixels: the tests are about order, not about time.
Scene small_scene(Backend& backend, const Gaussians& model) {
    backend.upload(model);
    Scene scene = generated_scene(backend, {0, 0, 1});
    for (View& view : scene.train) {
        view.camera.fx = view.camera.fy = 15;
        view.camera = with_size(view.camera, 24, 16);
        view.load = [] {
            return ViewImage{Image{24, 16, 3, std::vector<std::uint8_t>(24 * 16 * 3, 90), {}}, std::nullopt};
        };
    }
    return scene;
}

/// Writes down every request.
class WatchedEngine : public test::ForwardingEngine {
  public:
    explicit WatchedEngine(const AppearanceSpec& appearance) : ForwardingEngine(appearance) {
        traits_.stage_passes = 2;
        traits_.ceilings = [] { return Ceilings{1e9, 1e9}; };
    }
    void step(const StepRequest& request) override {
        steps += "s";
        ids.insert(request.target.id.view);
        largest_rate = std::max(largest_rate, *std::ranges::max_element(request.rates.groups));
        noise = request.rates.noise;
        background = request.background;
        ForwardingEngine::step(request);
    }
    void synchronize() override { steps += "."; }
    std::vector<StageCost> measure_stages(std::optional<int> pass) override {
        steps += pass ? std::to_string(*pass) : ")";
        return ForwardingEngine::measure_stages(pass ? 0 : pass);  // those of a pass are those of all
    }
    std::optional<double> time_frames(const std::vector<RenderRequest>& views, int repeats) override {
        frames.push_back(views.at(0).camera);
        return repeats;
    }

    std::string steps;
    std::set<int> ids;
    double largest_rate = 0;
    float noise = 0;
    Vec3<float> background{};
    std::vector<CameraParams<float>> frames;
};

TEST(Bench, TimesStepsInARowBeforeAnyMarksAndLeavesTheModelAsItIs) {
    test::BackendOf<WatchedEngine> backend(kSh);
    const Gaussians model = generated_gaussians(60, 1, kSh);
    const Scene scene = small_scene(backend, model);
    const BenchResult result = run_bench(backend, some_options(), scene, model, {.repeat = 3, .frame_repeat = 7});
    EXPECT_EQ(backend->steps,
              ".sss."
              "sss."
              "s.s.s."
              "0s.0sss.1sss.)"
              "0s.0sss.1sss.)")
        << "warm-up, in a row, one by one, in passes, the same without residuals";
    EXPECT_EQ(backend->ids, (std::set<int>{0, 2, 5})) << "three of eight views, spread";
    EXPECT_LT(backend->largest_rate, 1e-7);
    EXPECT_GT(backend->noise, 0) << "with noise the device has more to do";
    EXPECT_EQ(backend->background.z, 1);
    ASSERT_EQ(backend->frames.size(), 2u);
    EXPECT_EQ(backend->frames[0].width, 24);
    EXPECT_EQ(backend->frames[1].width, 1280);
    EXPECT_EQ(result.frames[1].seconds, 7);
    EXPECT_EQ(result.num_gaussians, 60);
    EXPECT_EQ(result.width, 24);
    EXPECT_EQ(result.stages.size(), 6u);
    EXPECT_EQ(result.stages[0].items, 60) << "per iteration";
    ASSERT_EQ(result.without_residual.size(), 6u);
    EXPECT_LT(result.without_residual[0].bytes, result.stages[0].bytes) << "preprocessing reads residuals";
    EXPECT_EQ(appearance_share(result, 0).bytes, result.stages[0].bytes - result.without_residual[0].bytes);
    EXPECT_EQ(result.without_residual[2].bytes, result.stages[2].bytes) << "blending does not";
    EXPECT_EQ(backend.download(false).active_degree, model.active_degree);
    const Gaussians after = backend.download(false);
    for (int g = 0; g < kNumGroups; ++g)
        for (std::size_t i = 0; i < after.groups[g].param.size(); ++i)
            ASSERT_NEAR(after.groups[g].param[i], model.groups[g].param[i], 1e-5f);
}

TEST(Bench, AnotherImageSizeKeepsScaleAndCentre) {
    Camera camera;
    camera.width = 800, camera.height = 801;
    camera.fx = 700, camera.fy = 710, camera.cx = 390, camera.cy = 405;
    const Camera wide = with_size(camera, 1280, 720);
    EXPECT_EQ(wide.width, 1280);
    EXPECT_EQ(wide.height, 720);
    EXPECT_EQ(wide.fx, 700);
    EXPECT_EQ(wide.fy, 710);
    EXPECT_EQ(wide.cx - 640, camera.cx - 400);
    EXPECT_EQ(wide.cy - 360, camera.cy - 400.5);
}

TEST(Bench, StagesFarAboveTheirFloorStandOutWithTheReason) {
    BenchResult r;
    r.subject = "a set";
    r.device = "a device";
    r.ceilings = {1e9, 2e9};
    r.num_gaussians = 5;
    r.frames = {{800, 600, 4, 0.002}};
    r.repeat = 10;
    r.iteration_seconds = 0.010, r.iteration_seconds_median = 0.011;
    r.stages = {{"far", 0.004, 2e6, "pixel", 1e6, 1e6, "it waits", true},
                {"near", 0.003, 0, "pixel", 1e6, 4e6, "unused"},
                {"bare", 0.001, 1, "pixel", 0, 0, ""}};
    r.without_residual = {{"far", 0.003, 2e6, "pixel", 5e5, 1e6, "it waits"}, r.stages[1], r.stages[2]};
    r.memory = {{{"model", 3 << 20, "Gaussian", 1 << 20}}, 3 << 20, 4 << 20};
    r.default_seconds = 0.010, r.deterministic_seconds = 0.012;
    const std::string text = format_bench(r);
    for (const char* line :
         {"a set\na device; 5 Gaussians; copy 1.0 GB/s, 2 G single-precision FMA/s\n",
          "| 800x600, 4 views |    2.000 | 500.0 |\n",
          "10.000 ms (mean of 10 in a row), 11.000 ms (median of 10 that are each waited for)\n",
          "the stages add up to 8.000 ms\n", "with --deterministic 12.000 ms, without 10.000 ms: 1.20 times\n",
          "| far   | pixel     | copy     | 4.000 |       2 |       2.000 |    1.000 |        **4.0** |\n",
          "| near  | pixel     | FMA      | 3.000 |       0 |       0.000 |    2.000 |            1.5 |\n",
          "| bare  | pixel     | -        | 1.000 |   1e-06 | 1000000.000 |    0.000 |              - |\n",
          "\n\nAbove 3 floors:\n\n- far: it waits\n",
          "| appearance in | items are | bound by |    ms | M items | ns per item | floor ms | measured/floor |\n",
          "| far           | pixel     | copy     | 1.000 |       2 |       0.500 |    0.500 |            2.0 |\n",
          "device memory: peak 4.0 MiB, now 3.0 MiB: model 3.0 MiB (3 B a Gaussian)\n"})
        EXPECT_NE(text.find(line), std::string::npos) << line << "is not in\n" << text;

    const std::string plain = format_bench(r, TableStyle::kTerminal);
    EXPECT_EQ(plain.find("**"), std::string::npos) << plain;
    EXPECT_NE(plain.find(" 4.0 |\n"), std::string::npos) << plain;

    const auto json = parse_json(bench_json({r, r}));
    ASSERT_EQ(json["results"].size(), 2u);
    const auto& first = json["results"][0];
    EXPECT_EQ(first["num_gaussians"], 5);
    EXPECT_EQ(first["frames"][0]["seconds"], 0.002);
    EXPECT_EQ(first["iteration"]["deterministic_seconds"], 0.012);
    EXPECT_EQ(first["stages"][0]["stage"], "far");
    EXPECT_EQ(first["stages"][0]["floor_seconds"], 0.001);
    EXPECT_EQ(first["stages"][0]["note"], "it waits");
    EXPECT_TRUE(first["stages"][2]["bound_by"].is_null());
    EXPECT_EQ(first["appearance"].size(), 1u);
    EXPECT_EQ(first["device_memory"]["peak_bytes"], 4 << 20);
}

TEST(CpuCeilings, AreThoseOfSomeMachine) {
    const Ceilings c = cpu_ceilings();
    EXPECT_GT(c.copy_bytes_per_second, 1e8);
    EXPECT_GT(c.operations_per_second, 1e8);
    EXPECT_LT(c.operations_per_second, 1e15);
}

TEST(GeneratedSet, DependsOnSeedAndIndexAlone) {
    set_num_threads(1);
    const Gaussians a = generated_gaussians(3000, 4, kSh);
    set_num_threads(0);
    const Gaussians same = generated_gaussians(3000, 4, kSh), other = generated_gaussians(3000, 5, kSh);
    EXPECT_EQ(a.count, 3000);
    EXPECT_EQ(a.active_degree, 3);
    for (int g = 0; g < int(Group::kSmoothing); ++g) {
        EXPECT_EQ(a.groups[g].param, same.groups[g].param) << kGroupNames[g];
        EXPECT_NE(a.groups[g].param, other.groups[g].param) << kGroupNames[g];
        for (const float x : a.groups[g].param) ASSERT_TRUE(std::isfinite(x)) << kGroupNames[g];
    }
    double far = 0, log_scale = 0;
    for (std::size_t i = 0; i < 3000; ++i) {
        const float* p = &a[Group::kMean].param[3 * i];
        far = std::max(far, double(std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])));
        log_scale += a[Group::kScale].param[3 * i] / 3000;
    }
    EXPECT_LE(far, 1.01);
    EXPECT_GT(far, 0.9);
    EXPECT_NEAR(log_scale, std::log(0.5 / std::cbrt(3000.0)), 0.1);
}

TEST(GeneratedSet, ViewsShowTheSetItself) {
    const auto backend = make_cpu_backend(kSh);
    backend->upload(generated_gaussians(500, 0, kSh));
    const Scene scene = generated_scene(*backend, {0, 0, 1});
    ASSERT_EQ(scene.train.size(), 8u);
    EXPECT_GT(scene.extent, 1);
    RenderRequest request;
    request.camera = camera_params(scene.train[3].camera);
    request.background = {0, 0, 1};
    RenderedImage rendered;
    backend->render(request, rendered);
    const ViewImage image = scene.train[3].load();
    EXPECT_EQ(image.color.u8, quantized_render(rendered).u8);
    const auto middle = std::size_t(360 * 1280 + 640);
    EXPECT_GT(rendered.alpha[middle], 0.2f) << "the cameras look at the set";
    EXPECT_LT(rendered.alpha[10 * 1280 + 5], 0.01f) << "and see past it";
}

TEST(Bench, RepeatsByDeviceUnlessTheUserSays) {
    EXPECT_EQ(bench_options(Device::kCpu, 0, 0).repeat, 20);
    EXPECT_EQ(bench_options(Device::kCpu, 0, 0).frame_repeat, 3);
    EXPECT_EQ(bench_options(Device::kCpu, 7, 5).repeat, 7);
    EXPECT_EQ(bench_options(Device::kCpu, 7, 5).frame_repeat, 5);
}

TEST(Bench, ComparesBothSettingsOfDeterminismOnlyWhenAsked) {
    test::BackendOf<WatchedEngine> backend(kSh);
    const Gaussians model = generated_gaussians(60, 1, kSh);
    const Scene scene = small_scene(backend, model);
    TrainOptions options = some_options();
    options.device = Device::kCpu;
    const BenchOptions few{.repeat = 1, .frame_repeat = 1};
    EXPECT_FALSE(bench_model(backend, options, scene, model, few, false).deterministic_seconds);
    const BenchResult both = bench_model(backend, options, scene, model, few, true);
    EXPECT_EQ(both.default_seconds, both.iteration_seconds);
    EXPECT_TRUE(both.deterministic_seconds);
    options.deterministic = true;
    const BenchResult other = bench_model(backend, options, scene, model, few, true);
    EXPECT_EQ(other.deterministic_seconds, other.iteration_seconds);
    EXPECT_TRUE(other.default_seconds);
}

// What the frame time protocol asks a backend for, its statistics, and its table.

/// Says that frames of a view take as many seconds as its camera stands to the right.
class TimedEngine : public test::FakeEngine {
  public:
    void render(const RenderRequest& request, const SplatParts*, RenderedImage& out) override {
        warm_ups += request.camera.translation.x;
        out.width = request.camera.width;
    }
    std::optional<double> time_frames(const std::vector<RenderRequest>& views, int repeats) override {
        EXPECT_EQ(views.size(), 1u);
        EXPECT_EQ(warm_ups, 21) << "every view was seen before the first is timed";
        request = views.at(0), frames = repeats;
        return views[0].camera.translation.x;
    }
    double warm_ups = 0;
    RenderRequest request;
    int frames = 0;
};

TEST(FrameTimes, AreStatisticsOverTheMeansOfViews) {
    std::vector<Camera> cameras(4);
    for (Camera& camera : cameras)
        camera.width = 800, camera.height = 600, camera.fx = camera.fy = 700, camera.cx = 390, camera.cy = 300;
    const double x[] = {9, 2, 4, 6};
    for (int k = 0; k < 4; ++k) cameras[k].translation.x() = x[k];
    test::BackendOf<TimedEngine> backend;
    const FrameTimes times = measure_frame_times(backend, cameras, {0, 1, 0}, 5);
    EXPECT_EQ(times.device, "fake");
    EXPECT_EQ(times.num_views, 4);
    EXPECT_EQ(times.frames_per_view, 5);
    EXPECT_EQ(times.mean, 5.25);
    EXPECT_EQ(times.median, 5);
    EXPECT_EQ(times.min, 2);
    EXPECT_EQ(times.max, 9);
    EXPECT_EQ(backend->frames, 5);
    EXPECT_EQ(backend->request.camera.width, 1280);
    EXPECT_EQ(backend->request.camera.height, 720);
    EXPECT_EQ(backend->request.camera.fx, 700) << "cropped or extended, not rescaled";
    EXPECT_EQ(backend->request.camera.cx, 630);
    EXPECT_EQ(backend->request.background.y, 1);
    EXPECT_EQ(backend->request.isp.mode, IspMode::kNone) << "no PPISP";
    cameras.resize(1), cameras[0].translation.x() = 21, backend->warm_ups = 0;
    EXPECT_EQ(measure_frame_times(backend, cameras, {0, 1, 0}, 1).median, 21);

    const std::string text = markdown_table(frame_times_table({{"a|b", "lego", "sh", 7, times}}));
    EXPECT_NE(text.find("| a\\|b | lego  | sh    | fake   |   7 |     4 |             5 | 5250.000 |  5000.000 | "
                        "2000.000 | 9000.000 |\n"),
              std::string::npos)
        << text;
}

}  // namespace
}  // namespace gs
