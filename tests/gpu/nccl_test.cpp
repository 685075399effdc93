// SPDX-License-Identifier: Apache-2.0
// NCCL itself: a rank alone, and a rank on each of two GPUs. Skipped where there is no NCCL or too few GPUs.
#include "kernels/ranks/connect_devices.h"
#include "kernels/ranks/link_speed.h"
#include "kernels/ranks/nccl_library.h"
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

/// Trains a little on `size` ranks, each on the device of its number, connected by NCCL where that is asked for.
Gaussians trained(const RankViews& views, int size, bool by_nccl, bool in_a_row = false) {
    Gaussians after;
    on_ranks(size, [&](Communicator& ranks) {
        use_cuda_device(ranks.rank());
        if (by_nccl) {
            EXPECT_EQ(connect_devices(ranks, cuda_device_id()), "");
            EXPECT_NE(ranks.link(), nullptr);
        }
        BackendOptions options;
        options.deterministic = true;
        std::unique_ptr<Backend> own = make_cuda_backend(views.model.appearance, options);
        if (ranks.rank() > 0) return follow(ranks, *own, in_a_row ? targets_in_a_row(views) : views.targets());
        RankedBackend backend(ranks, std::move(own), kViews);
        after = in_a_row ? train_in_a_row(views, backend) : train_with_noise(views, backend);
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
    const RankViews views(info, kRows, 90);
    for (const bool in_a_row : {false, true}) {
        Gaussians by_nccl = trained(views, 2, true, in_a_row), by_host = trained(views, 2, false, in_a_row);
        expect_equal(by_nccl, by_host);
    }
}

TEST_F(GpuNccl, EndsATrainingWithALostRank) {
    if (cuda_device_count() < 2) GTEST_SKIP() << "needs two GPUs, there is " << cuda_device_count();
    const RankViews views(info, kRows, 90);
    on_ranks(2, [&](Communicator& ranks) {
        use_cuda_device(ranks.rank());
        EXPECT_EQ(connect_devices(ranks, cuda_device_id()), "");
        std::unique_ptr<Backend> own = make_cuda_backend(views.model.appearance);
        const auto targets = [&](StepRequest& request) {
            if (request.iteration == 5) throw DataError("the photograph is gone");
            request.target = views.target(request.target.id);
        };
        if (ranks.rank() == 1) return follow(ranks, *own, targets);
        RankedBackend backend(ranks, std::move(own), kViews);
        backend.upload(views.model);
        std::thread watch([&] {
            std::this_thread::sleep_for(std::chrono::seconds(2));
            ranks.abort();
        });
        const double start = seconds_now();
        const auto train = [&] {
            for (int k = 0; k < 8; ++k) {
                auto steps = views.steps();
                for (StepRequest& step : steps) step.iteration = k, step.isp_rate = 0;
                backend.step_on(steps);
            }
            backend.synchronize();
        };
        EXPECT_THROW(train(), DeviceError);
        EXPECT_LT(seconds_now() - start, 20);
        watch.join();
    });
}

TEST_F(GpuNccl, EndsAnExchangeWithALostRank) {
    if (cuda_device_count() < 2) GTEST_SKIP() << "needs two GPUs, there is " << cuda_device_count();
    const RankViews views(info, kRows, 90);
    on_ranks(2, [&](Communicator& ranks) {
        use_cuda_device(ranks.rank());
        EXPECT_EQ(connect_devices(ranks, cuda_device_id()), "");
        const auto backend = make_cuda_backend(views.model.appearance);
        RankArray<float> array(backend->shard()->device());
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
