// SPDX-License-Identifier: Apache-2.0
// Ranks on one device against the CPU, and against each other. Skipped where there is no device.
#include "tests/gpu/gpu_test.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/rank_threads.h"
#include "tests/kernels/rank_views.h"
#include "tests/kernels/ranks_on.h"

namespace gs::test {
namespace {

/// Calls use(backend) with a model that `size` ranks of the device hold.
template <class Fn>
void on_device(int size, const RankViews& views, Fn&& use, bool fixed_order = false, bool packed_moments = false) {
    with_ranked_backend(size, kViews, views.targets(), use, [&] {
        return make_cuda_engine(views.model.appearance,
                                {.deterministic = fixed_order, .packed_moments = packed_moments});
    });
}

struct TheDevice {
    static constexpr double kPicture = 1e-5, kSums = 1e-4;
    static std::unique_ptr<Engine> make_engine(const AppearanceSpec& appearance, bool fixed_order) {
        return make_cuda_engine(appearance, {.deterministic = fixed_order});
    }
    static void skip() { skip_without_device(); }
};
INSTANTIATE_TYPED_TEST_SUITE_P(Gpu, RanksOn, TheDevice);

class GpuRanks : public ::testing::TestWithParam<std::string> {
  protected:
    void SetUp() override { skip_without_device(); }
    const ModelInfo& info = appearance_model(GetParam());
};

TEST_P(GpuRanks, HaveTheGradientsThatTheCpuHas) {
    for (const RankViews& views :
         {RankViews(info), RankViews(info, kRows, 60), RankViews(info, kRows, 60).through_lenses()}) {
        const auto step = [&](Gaussians& after) {
            return [&](Backend& backend) {
                backend.upload(views.model);
                auto steps = views.steps();
                steps[0].gather_gradient_stats = true;
                backend.step_on(steps);
                backend.synchronize();
                EXPECT_EQ(backend.take_stats().num_nonfinite_gradients, 0);
                after = backend.download(true);
            };
        };
        // The device evaluates shared networks in half precision. A colour that is off by a thousandth turns the sign
        // of a pixel's error where it was less than that.
        const double tolerance = info.num_shared > 0 ? 0.05 : 2e-3;
        Gaussians cpu;
        with_ranked_backend(1, kViews, views.model.appearance, views.targets(), step(cpu));
        for (const int ranks : {1, 2, 3}) {
            SCOPED_TRACE(std::to_string(ranks) + " ranks, " + views.name());
            Gaussians gpu;
            on_device(ranks, views, step(gpu));
            EXPECT_EQ(gpu.step, cpu.step);
            for_arrays(cpu, gpu, [&](const auto& x, const auto& y, const std::string& what) {
                // A parameter's step has the usual length where the gradient is but rounding, too. The device does not
                // count views in which a splat lies within the image, but reaches no pixel.
                if (what.find("moment") != std::string::npos || what == "gradient statistic")
                    expect_close(x, y, tolerance, what);
            });
        }
    }
}

TEST_P(GpuRanks, TakeTheSameStepsInAnyNumber) {
    const RankViews pinholes(info, kRows, 60), lenses = RankViews(info, kRows, 60).through_lenses();
    for (const auto& [views, packed] : {std::pair(pinholes, false), {pinholes, true}, {lenses, false}}) {
        Gaussians one;
        for (const int ranks : {1, 2, 3}) {
            SCOPED_TRACE(std::to_string(ranks) + " ranks, " + views.name() + (packed ? ", packed moments" : ""));
            Gaussians after;
            on_device(
                ranks, views,
                [&](Backend& backend) {
                    backend.upload(views.model);
                    for (int k = 0; k < 3; ++k) backend.step_on(views.steps());
                    after = backend.download(true);
                },
                true, packed);
            if (ranks == 1)
                one = after;
            else
                for_arrays(one, after, [&](const auto& x, const auto& y, const std::string& what) {
                    // Where a moment is rounded up in one run, it may be rounded down in the other.
                    if (what != "PPISP") expect_close(x, y, packed ? 2e-2 : 1e-4, what);
                });
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Models, GpuRanks, ::testing::ValuesIn([] {
                             std::vector<std::string> names;
                             for (const ModelInfo* info : appearance_models()) names.push_back(info->name);
                             return names;
                         }()));

class GpuRanksOfOneModel : public Gpu {
  protected:
    const ModelInfo& info = appearance_model("sh");
};

TEST_F(GpuRanksOfOneModel, RenderSplatsOfEqualDepthInTheOrderOfTheModel) {
    RankViews views(info, kRows, 90);
    auto& means = views.model[Group::kMean].param;
    for (std::int64_t i = 0; i < kRows; ++i) std::copy_n(&means[3 * (i % 7)], 3, &means[3 * i]);
    std::vector<RenderRequest> requests(kViews);
    for (std::size_t k = 0; k < kViews; ++k) requests[k].camera = views.cameras[k];
    const auto plain = make_cuda_backend(views.model.appearance, {});
    plain->upload(views.model);
    std::vector<RenderedImage> expected, found;
    plain->render_all(requests, expected);
    for (const int ranks : {2, 3, 5}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        on_device(ranks, views, [&](Backend& backend) {
            backend.upload(views.model);
            backend.render_all(requests, found);
            for (std::size_t k = 0; k < kViews; ++k) expect_close(expected[k].rgb, found[k].rgb, 1e-5, "picture");
        });
    }
}

/// From the second step on, arrays have room for more splats than a view shows.
TEST_F(GpuRanksOfOneModel, PadArraysWithSplatsThatTouchNoTile) {
    for (const RankViews& views : {RankViews(info, 20000), RankViews(info, 20000).through_lenses()}) {
        SCOPED_TRACE(views.name());
        auto steps = views.steps();
        for (StepRequest& step : steps) step.rates = {};
        const auto instances_of = [](Backend& backend, const std::vector<StepRequest>& steps) {
            backend.step_on(steps);
            backend.synchronize();
            return double(backend.take_stats().num_instances);
        };
        double expected = 0;
        const auto plain = make_cuda_backend(views.model.appearance, {});
        plain->upload(views.model);
        for (const StepRequest& step : steps) expected += instances_of(*plain, {step});
        EXPECT_GT(expected, 0);
        for (const int ranks : {1, 2})
            on_device(ranks, views, [&](Backend& backend) {
                backend.upload(views.model);
                for (int k = 0; k < 4; ++k)
                    EXPECT_NEAR(instances_of(backend, steps), expected, 1e-3 * expected)
                        << ranks << " ranks, step " << k;
            });
    }
}

TEST_F(GpuRanksOfOneModel, CountTheBytesThatRanksOfTheCpuCount) {
    const RankViews views(info, kRows, 90);
    const auto step = [&](Traffic& traffic) {
        return [&](Backend& backend) {
            backend.upload(views.model);
            backend.step_on(views.steps());
            const RankCosts costs = backend.take_costs();
            traffic = costs.traffic;
            traffic.sent -= 48 * costs.splats_sent;  // the devices may see one more or less at an edge
            const LinkSpeed link = backend.measure_connection();
            EXPECT_GT(link.bytes_per_second, 0);
            EXPECT_EQ(link.device_latency_seconds > 0, traffic.device_exchanges > 0);
        };
    };
    Traffic cpu, gpu;
    with_ranked_backend(2, kViews, views.model.appearance, views.targets(), step(cpu));
    on_device(2, views, step(gpu));
    EXPECT_EQ(gpu.exchanges, cpu.exchanges);
    EXPECT_EQ(gpu.messages, cpu.messages);
    EXPECT_EQ(cpu.device_exchanges, 0);
    EXPECT_EQ(gpu.device_exchanges, kViews / 2 * 2) << "splats and sums of each round";
    // What is left are counts, losses and the sums of PPISP, and sums of splats of the other rank.
    EXPECT_NEAR(gpu.sent, cpu.sent, 36 * kViews);
}

TEST_F(GpuRanksOfOneModel, BeginStepsBeforeTheLastOneIsKnown) {
    const RankViews views(info, 20000, 90);
    RankViews large = views;
    for (float& scale : large.model[Group::kScale].param) scale += 4;
    const auto device_exchanges = [](Backend& backend) { return backend.take_costs().traffic.device_exchanges; };
    Gaussians expected;
    on_device(
        1, views, [&](Backend& backend) { expected = train_in_a_row(large, backend, true); }, true);
    on_device(
        1, views,
        [&](Backend& backend) {
            train_in_a_row(views, backend);
            EXPECT_GT(device_exchanges(backend), kStepsInARow * kViews) << "views show more than a quarter";
            Gaussians after = train_in_a_row(large, backend);
            EXPECT_GT(device_exchanges(backend), kStepsInARow * kViews) << "all Gaussians are in all tiles now";
            expect_equal(expected, after);
            // Steps that nobody asked about are finished before anything else is done.
            backend.step_on(large.steps());
            after = backend.download(true);
            EXPECT_EQ(after.step, (kStepsInARow + 1) * kViews);
        },
        true);
}

TEST_F(GpuRanksOfOneModel, KeepPlaceForViewsThatShowLittle) {
    constexpr std::int64_t kMany = 300000;
    for (const char* model : {"sh", "neural_wide"}) {
        SCOPED_TRACE(model);
        RankViews views(appearance_model(model), kMany);
        const auto& camera = views.cameras[0];
        const Vec3<float> behind = camera.position - camera.rotation.r2 * 100.0f;
        for (std::int64_t i = 0; i < kMany; ++i) {
            float* const p = views.model[Group::kMean].param.data() + 3 * i;
            if (i % 300) p[0] = behind.x, p[1] = behind.y, p[2] = behind.z;
        }
        const auto step = [&](int times, Gaussians& after) {
            return [&, times](Backend& backend) {
                for (int k = 0; k < times; ++k) {
                    backend.upload(views.model);
                    auto steps = views.steps();
                    steps.resize(2);
                    for (StepRequest& one : steps) one.rates.isp = 0;
                    backend.step_on(steps);
                }
                after = backend.download(true);
            };
        };
        Gaussians cpu, gpu;
        with_ranked_backend(1, kViews, views.model.appearance, views.targets(), step(1, cpu));
        on_device(1, views, step(2, gpu));  // at first views have room for a quarter
        const double tolerance = appearance_model(model).num_shared > 0 ? 0.05 : 2e-3;
        for_arrays(cpu, gpu, [&](const auto& x, const auto& y, const std::string& what) {
            if (what.find("moment") != std::string::npos) expect_close(x, y, tolerance, what);
        });
    }
}

}  // namespace
}  // namespace gs::test
