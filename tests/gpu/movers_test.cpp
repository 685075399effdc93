// SPDX-License-Identifier: Apache-2.0
// Steps that only visible Gaussians take, on the device and on ranks of it.
#include "tests/kernels/movers.h"

#include "tests/gpu/gpu_test.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/rank_threads.h"

namespace gs::test {
namespace {

class GpuMovers : public Gpu {};

TEST_F(GpuMovers, AreThoseThatTheViewShows) {
    for (const std::int64_t rows : {kRows, std::int64_t(3000)})  // with and without whole warps out of view
        for (const char* model : {"sh", "neural", "none"})
            for (const bool packed : {false, true}) {
                SCOPED_TRACE(std::string(model) + (packed ? ", packed moments" : ""));
                const RankViews views(appearance_model(model), rows, rows / 3);
                const auto backend =
                    make_cuda_backend(views.model.appearance, {.deterministic = true, .packed_moments = packed});
                // Where a moment is rounded up in one run, it may be rounded down in the other.
                expect_that_only_visible_move(*backend, views, {1e-5f, packed ? 1 / 64.0f : 1e-5f});
            }
}

TEST_F(GpuMovers, TakeWhatTheyMissed) {
    for (const std::int64_t rows : {kRows, std::int64_t(3000)})
        for (const char* model : {"sh", "sv", "neural", "none"})
            for (const bool packed : {false, true}) {
                SCOPED_TRACE(std::string(model) + (packed ? ", packed moments" : ""));
                const RankViews views(appearance_model(model), rows, rows / 2);
                const auto backend =
                    make_cuda_backend(views.model.appearance, {.deterministic = true, .packed_moments = packed});
                // Older second moments are rounded to eight bits when they are uploaded.
                expect_missed_steps(
                    *backend, views, 1, [&](const auto& steps) { backend->step(steps[0]); }, packed ? 1e-2 : 1e-4);
            }
}

TEST_F(GpuMovers, TakeWhatTheyMissedOnRanks) {
    const RankViews views(appearance_model("sh"), kRows, 150);
    for (const int ranks : {1, 3}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(
            ranks, kViews, views.targets(),
            [&](Backend& backend) {
                expect_missed_steps(
                    backend, views, kViews, [&](const auto& steps) { backend.step_on(steps); }, 1e-4);
            },
            [&] { return make_cuda_engine(views.model.appearance, {.deterministic = true}); });
    }
}

TEST_F(GpuMovers, CountASkippedStepAsMissed) {
    const RankViews views(appearance_model("sh"));
    const auto backend = make_cuda_backend(views.model.appearance, {.deterministic = true});
    expect_that_a_skipped_step_is_missed(*backend, views);
}

TEST_F(GpuMovers, AreTheSameOnAnyNumberOfRanks) {
    const RankViews views(appearance_model("sh"), kRows, 60);
    Gaussians one;
    for (const int ranks : {1, 2, 3}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(
            ranks, kViews, views.targets(),
            [&](Backend& backend) {
                Gaussians after = train_visible(views, backend);
                if (ranks == 1) one = after;
                for_arrays(one, after, [](const auto& x, const auto& y, const std::string& what) {
                    if (what != "PPISP") expect_close(x, y, 1e-4, what);
                });
            },
            [&] {
                EngineOptions options;
                options.deterministic = true;
                return make_cuda_engine(views.model.appearance, options);
            });
    }
}

}  // namespace
}  // namespace gs::test
