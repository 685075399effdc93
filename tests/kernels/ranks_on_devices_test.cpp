// SPDX-License-Identifier: Apache-2.0
// Ranks whose arrays lie on a device do what ranks on hosts do, to the bit, whichever way the arrays take. The device
// is memory of the host, so that the CPU backend computes on it, and NCCL is fake_nccl.
#include <algorithm>
#include <cstdlib>

#include "appearance/neural/neural.h"
#include "appearance/sh/sh.h"
#include "kernels/engines/cpu_engine.h"
#include "kernels/ranks/connect_devices.h"
#include "tests/kernels/fake_device_stream.h"
#include "tests/kernels/rank_threads.h"
#include "tests/kernels/rank_views.h"

namespace gs::test {
namespace {

template <class Model> class EngineOnDevice final : public CpuEngine<Model> {
  public:
    EngineOnDevice() : CpuEngine<Model>({}) { this->traits_.stream = &device_; }
    /// Returns the same places for all views in turn, like a scratch block: each view loses what lay there.
    ScratchPlaces room_for_splats(const CameraParams<float>&, std::size_t splats, std::size_t placed, bool,
                                  bool last) override {
        constexpr std::size_t kAlignment = 3 * 5;  // of as many ranks as there may be
        if (last)
            EXPECT_GE(placed, splats) << "all of the last view";
        else
            EXPECT_LE(placed, splats + kAlignment) << "none of other views";
        splats_.assign(placed * sizeof(WireSplat), std::byte(0xff));
        sums_.assign(placed * sizeof(SplatSums<float>), std::byte(0xff));
        if (placed == 0) return {};
        return {splats_.data(), sums_.data()};
    }
    /// Afterwards nothing needs the splats that lie in their place.
    void update_rows(const DeviceArray<ViewReport>& reports, const std::vector<StepRequest>& views,
                     const std::vector<ProjectedView>& projected,
                     const std::vector<DeviceArray<SplatSums<float>>>& sums, std::int64_t num_gaussians,
                     DeviceArray<float>& shared_gradient) override {
        std::fill(splats_.begin(), splats_.end(), std::byte(0xff));
        CpuEngine<Model>::update_rows(reports, views, projected, sums, num_gaussians, shared_gradient);
    }

  private:
    FakeDevice device_;
    std::vector<std::byte> splats_, sums_;
};

enum class Way { kHosts, kThroughHosts, kNccl };

/// What several ranks compute.
struct Results {
    Gaussians model;
    std::vector<RenderedImage> images;
    std::vector<float> scores;
    ResidualScores residuals;
    double error = 0;
    Traffic traffic;
};

Results results(const RankViews& views, int size, Way way, bool in_a_row) {
    Results found;
    on_ranks(size, [&](Communicator& ranks) {
        if (way == Way::kNccl) {
            EXPECT_EQ(connect_devices(ranks, std::to_string(ranks.rank())), "");
            EXPECT_NE(ranks.link(), nullptr);
        }
        std::unique_ptr<Engine> own;
        if (way == Way::kHosts)
            own = make_cpu_engine(views.model.appearance);
        else
            own = std::make_unique<EngineOnDevice<appearance::Sh>>();
        if (ranks.rank() > 0) return follow(ranks, *own, in_a_row ? targets_in_a_row(views) : views.targets());
        Backend backend(std::move(own), &ranks, kViews);
        found.model = in_a_row ? train_in_a_row(views, backend) : train_with_noise(views, backend);
        found.traffic = backend.take_costs().traffic;
        std::vector<RenderRequest> requests(kViews);
        for (std::size_t k = 0; k < kViews; ++k) requests[k].camera = views.cameras[k];
        backend.render_all(requests, found.images);
        found.scores = backend.scores(requests);
        found.residuals = backend.residual_scores(kViews, [&](std::size_t view) { return views.step(view); });
        found.error = backend.half_squared_error(views.step(2));
    });
    return found;
}

/// Expects that `steps` steps exchange on devices what they exchange on hosts. With `rooms`, they do without the
/// numbers of splats, but fill room with splats that are none, and repeat what did not fit, and what was begun
/// meanwhile.
void expect_traffic(const Traffic& devices, const Traffic& hosts, int size, bool rooms, std::int64_t rows, int steps) {
    const int rounds = (kViews + size - 1) / size;
    // In each try: splats from each other rank in turn, and sums.
    EXPECT_EQ(devices.device_exchanges % (size * rounds), 0);
    const std::int64_t tries = devices.device_exchanges / (size * rounds);
    if (!rooms) {
        EXPECT_EQ(tries, steps);
        EXPECT_EQ(devices.sent, hosts.sent);
        EXPECT_EQ(devices.received, hosts.received);
        EXPECT_EQ(devices.messages, hosts.messages);
        EXPECT_EQ(devices.exchanges, hosts.exchanges);
        return;
    }
    EXPECT_GE(tries, steps);
    EXPECT_LE(tries, steps + 2) << "a view is made room for once";
    EXPECT_EQ(tries > steps, rows == kRows) << "where a view shows more than a quarter of many Gaussians";
    const int counts = steps * (size - 1) * rounds;
    EXPECT_EQ(devices.exchanges, hosts.exchanges - counts + (tries - steps) * size * rounds);
    EXPECT_GE(devices.sent, hosts.sent - 8.0 * counts);
    constexpr double kBytesOfSplat = 48 + 36, kRest = 4096;  // commands and losses
    EXPECT_LE(devices.sent, hosts.sent + double(tries) * (kBytesOfSplat * double(rows) * kViews + kRest))
        << "no room is larger than a rank";
}

TEST(RanksOnDevices, ComputeWhatRanksOnHostsCompute) {
#ifdef FAKE_NCCL_LIBRARY
    ::setenv("GSAPP_NCCL", FAKE_NCCL_LIBRARY, 1);
    const std::vector<Way> ways = {Way::kThroughHosts, Way::kNccl};
#else
    const std::vector<Way> ways = {Way::kThroughHosts};
#endif
    // More ranks than views and than rows, too: some project nothing, and some render nothing.
    for (const auto& [rows, residuals, most_ranks] : {std::tuple(kRows, std::int64_t(90), 3), {2, 1, 5}}) {
        const RankViews views(appearance_model("sh"), rows, residuals);
        for (const int size : {1, 2, most_ranks}) {
            for (const bool in_a_row : {false, true}) {
                Results hosts = results(views, size, Way::kHosts, in_a_row);
                EXPECT_EQ(hosts.traffic.device_exchanges, 0);
                for (const Way way : ways) {
                    SCOPED_TRACE(std::to_string(rows) + " rows, " + std::to_string(size) + " ranks" +
                                 (way == Way::kNccl ? ", by NCCL" : "") + (in_a_row ? ", steps in a row" : ""));
                    Results devices = results(views, size, way, in_a_row);
                    expect_equal(hosts.model, devices.model);
                    ASSERT_EQ(devices.images.size(), hosts.images.size());
                    for (std::size_t k = 0; k < kViews; ++k) EXPECT_EQ(devices.images[k].rgb, hosts.images[k].rgb) << k;
                    EXPECT_EQ(devices.scores, hosts.scores);
                    EXPECT_EQ(devices.residuals.worth, hosts.residuals.worth);
                    EXPECT_EQ(devices.error, hosts.error);
                    expect_traffic(devices.traffic, hosts.traffic, size, size == 1 || way == Way::kNccl, rows,
                                   in_a_row ? kStepsInARow : 3);
                }
            }
        }
    }
    ::unsetenv("GSAPP_NCCL");
}

/// Gradients of shared weights may come when the next step is asked for. Steps that have to be repeated, and others
/// that need to know what became of the last one, must not forget it before.
TEST(RanksOnDevices, EndStepsOfSharedWeightsBeforeTheyForgetThem) {
#ifdef FAKE_NCCL_LIBRARY
    ::setenv("GSAPP_NCCL", FAKE_NCCL_LIBRARY, 1);
    const RankViews views(appearance_model("neural"));
    const auto train = [&](int size, bool by_nccl) {
        Gaussians after;
        on_ranks(size, [&](Communicator& ranks) {
            if (by_nccl) {
                EXPECT_EQ(connect_devices(ranks, std::to_string(ranks.rank())), "");
            }
            std::unique_ptr<Engine> own;
            if (by_nccl)
                own = std::make_unique<EngineOnDevice<appearance::Neural>>();
            else
                own = make_cpu_engine(views.model.appearance);
            if (ranks.rank() > 0) return follow(ranks, *own, views.targets());
            Backend backend(std::move(own), &ranks, kViews);
            backend.upload(views.model);
            for (int k = 0; k < 5; ++k) {
                auto steps = views.steps();  // at first there is too little room
                for (StepRequest& step : steps) step.iteration = k, step.rates.isp = k < 3 ? 0 : 1e-3;
                backend.step_on(steps);
            }
            after = backend.download(true);
        });
        return after;
    };
    for (const int size : {1, 2}) {
        SCOPED_TRACE(std::to_string(size) + " ranks");
        Gaussians hosts = train(size, false), devices = train(size, true);
        expect_equal(hosts, devices);
    }
    ::unsetenv("GSAPP_NCCL");
#else
    GTEST_SKIP() << "built without NCCL's header";
#endif
}

}  // namespace
}  // namespace gs::test
