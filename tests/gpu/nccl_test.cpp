// SPDX-License-Identifier: Apache-2.0
// NCCL itself: a rank alone, and a rank on each of two GPUs. Skipped where there is no NCCL or too few GPUs.
#include <latch>

#include "kernels/ranks/communicator.h"
#include "kernels/ranks/connect_devices.h"
#include "tests/gpu/gpu_test.h"
#include "tests/kernels/rank_threads.h"
#include "tests/kernels/rank_views.h"

namespace gs::test {
namespace {

class GpuNccl : public Gpu {
  protected:
    void SetUp() override {
        skip_without_device();
        if (IsSkipped()) return;
        if (const NcclFinding nccl = find_nccl(); !nccl.why_not.empty()) GTEST_SKIP() << nccl.why_not;
    }
    const ModelInfo& info = appearance_model("sh");
};

/// How some ranks train a little: through `views_per_step` views a step, and with `in_a_row` as train_in_a_row() says,
/// else with noise and densification.
struct Training {
    int views_per_step = kViews;
    bool in_a_row = false, fixed_order = true;
};

/// Trains on `size` ranks, each on the device of its number, connected by NCCL where that is asked for.
Gaussians trained(const RankViews& views, int size, bool by_nccl, const Training& how = {}) {
    Gaussians after;
    on_ranks(size, [&](Communicator& ranks) {
        use_cuda_device(ranks.rank());
        if (by_nccl) {
            EXPECT_EQ(connect_devices(ranks, cuda_device_id()), "");
            EXPECT_NE(ranks.link(), nullptr);
        }
        EngineOptions options;
        options.deterministic = how.fixed_order;
        std::unique_ptr<Engine> own = make_cuda_engine(views.model.appearance, options);
        if (ranks.rank() > 0) return follow(ranks, *own, how.in_a_row ? targets_in_a_row(views) : views.targets());
        Backend backend(std::move(own), &ranks, how.views_per_step);
        after =
            how.in_a_row ? train_in_a_row(views, backend, false, how.views_per_step) : train_with_noise(views, backend);
        EXPECT_EQ(backend.measure_connection().bytes_per_second > 0, size > 1);
    });
    return after;
}

TEST_F(GpuNccl, TakesARankAlone) {
    const RankViews views(info, kRows, 90);
    Gaussians with = trained(views, 1, true), without = trained(views, 1, false);
    expect_equal(with, without);
}

TEST_F(GpuNccl, IsRefusedToRanksThatShareAGpu) {
    on_ranks(2, [](Communicator& ranks) {
        EXPECT_EQ(connect_devices(ranks, cuda_device_id()), "rank 0 and rank 1 share a GPU");
        EXPECT_EQ(ranks.link(), nullptr);
    });
}

TEST_F(GpuNccl, TakesSplatsBetweenTwoGpusAsTheHostDoes) {
    if (cuda_device_count() < 2) GTEST_SKIP() << "needs two GPUs, there is " << cuda_device_count();
    for (const char* model : {"sh", "neural"}) {
        const RankViews views(appearance_model(model), kRows, 90);
        // With three views a rank has none to render in the last round.
        for (const Training& how : {Training{}, Training{4, true}, Training{3, true}}) {
            SCOPED_TRACE(model + std::string(how.in_a_row ? " in a row, " : ", ") + std::to_string(how.views_per_step));
            Gaussians by_nccl = trained(views, 2, true, how), by_host = trained(views, 2, false, how);
            expect_equal(by_nccl, by_host);
        }
    }
}

TEST_F(GpuNccl, TakesSplatsInAnyOrderOfSums) {
    if (cuda_device_count() < 2) GTEST_SKIP() << "needs two GPUs, there is " << cuda_device_count();
    const RankViews views(info, kRows, 90);
    const Training how{3, true, false};
    Gaussians by_nccl = trained(views, 2, true, how), by_host = trained(views, 2, false, how);
    for_arrays(by_nccl, by_host, [](const auto& x, const auto& y, const std::string& what) {
        if (what.find("moment") != std::string::npos) expect_close(x, y, 2e-3, what);
    });
}

TEST_F(GpuNccl, EndsATrainingWithALostRank) {
    if (cuda_device_count() < 2) GTEST_SKIP() << "needs two GPUs, there is " << cuda_device_count();
    const RankViews views(info, kRows, 90);
    constexpr int kLast = 5;
    std::latch ended(1);
    on_ranks(2, [&](Communicator& ranks) {
        use_cuda_device(ranks.rank());
        EXPECT_EQ(connect_devices(ranks, cuda_device_id()), "");
        std::unique_ptr<Engine> own = make_cuda_engine(views.model.appearance);
        // Rank 1 takes no notice in the last step, for whose sums rank 0 waits when it reads what has become of it.
        const auto targets = [&](StepRequest& request) {
            if (request.iteration == kLast) {
                ended.wait();
                throw DataError("the photograph is gone");
            }
            request.target = views.target(request.target.id.view);
        };
        if (ranks.rank() == 1) return follow(ranks, *own, targets);
        Backend backend(std::move(own), &ranks, kViews);
        backend.upload(views.model);
        std::thread watch([&] {
            std::this_thread::sleep_for(std::chrono::seconds(2));
            ranks.abort();
        });
        const auto begin_steps = [&] {
            for (int k = 0; k <= kLast; ++k) {
                auto steps = views.steps();
                for (StepRequest& step : steps) step.iteration = k, step.rates.isp = 0;
                backend.step_on(steps);
            }
        };
        EXPECT_NO_THROW(begin_steps());
        const double start = seconds_now();
        EXPECT_THROW(backend.synchronize(), DeviceError);
        EXPECT_LT(seconds_now() - start, 20);
        ended.count_down();
        watch.join();
    });
}

TEST_F(GpuNccl, EndsAnExchangeWithALostRank) {
    if (cuda_device_count() < 2) GTEST_SKIP() << "needs two GPUs, there is " << cuda_device_count();
    const RankViews views(info, kRows, 90);
    on_ranks(2, [&](Communicator& ranks) {
        use_cuda_device(ranks.rank());
        EXPECT_EQ(connect_devices(ranks, cuda_device_id()), "");
        const auto engine = make_cuda_engine(views.model.appearance);
        DeviceArray<float> array(engine->traits().stream);
        array.resize(1 << 20);
        const auto exchange = [&] {
            const std::size_t other = std::size_t(1 - ranks.rank());
            std::vector<ConstBytes> out(2);
            std::vector<Bytes> in(2);
            out[other] = array.bytes(0, 1 << 19), in[other] = array.bytes(1 << 19, 1 << 20);
            ranks.exchange(out, in, array.device());
        };
        exchange();
        if (ranks.rank() == 1) return;  // is lost
        std::thread watch([&] {
            std::this_thread::sleep_for(std::chrono::seconds(1));
            ranks.abort();
        });
        const double start = seconds_now();
        EXPECT_THROW(
            {
                exchange();
                array.device()->wait();
                exchange();
            },
            DeviceError);
        EXPECT_LT(seconds_now() - start, 20);
        watch.join();
    });
}

}  // namespace
}  // namespace gs::test
