// SPDX-License-Identifier: Apache-2.0
// Steps that only visible Gaussians take, on the CPU and on its ranks.
#include "tests/kernels/movers.h"

#include "tests/kernels/backends.h"
#include "tests/kernels/rank_threads.h"

namespace gs::test {
namespace {

TEST(Movers, AreThoseThatTheViewShows) {
    for (const std::int64_t num_residuals : {kRows, std::int64_t(60)})
        for (const char* model : {"sh", "neural"}) {
            SCOPED_TRACE(model);
            const RankViews views(appearance_model(model), kRows, num_residuals);
            const auto backend = make_cpu_backend(views.model.appearance);
            expect_that_only_visible_move(*backend, views);
        }
}

TEST(Movers, TakeWhatTheyMissed) {
    for (const char* model : {"sh", "sv", "neural"}) {
        SCOPED_TRACE(model);
        const RankViews views(appearance_model(model), kRows, 150);
        const auto backend = make_cpu_backend(views.model.appearance);
        expect_missed_steps(*backend, views, 1, [&](const auto& steps) { backend->step(steps[0]); });
    }
}

TEST(Movers, TakeWhatTheyMissedOnRanks) {
    const RankViews views(appearance_model("sh"), kRows, 150);
    for (const int ranks : {1, 3}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(ranks, kViews, views.model.appearance, views.targets(), [&](Backend& backend) {
            expect_missed_steps(backend, views, kViews, [&](const auto& steps) { backend.step_on(steps); });
        });
    }
}

TEST(Movers, CountASkippedStepAsMissed) {
    const RankViews views(appearance_model("sh"));
    const auto backend = make_cpu_backend(views.model.appearance);
    expect_that_a_skipped_step_is_missed(*backend, views);
}

TEST(Movers, AreTheSameOnAnyNumberOfRanks) {
    const RankViews views(appearance_model("sh"), kRows, 60);
    Gaussians one;
    for (const int ranks : {1, 2, 3}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(ranks, kViews, views.model.appearance, views.targets(), [&](Backend& backend) {
            Gaussians after = train_visible(views, backend);
            if (ranks == 1) {
                one = after;
                return;
            }
            for_arrays(one, after, [](const auto& x, const auto& y, const std::string& what) {
                if (what == "PPISP") return;  // steps of the usual length along gradients that are but rounding
                expect_close(x, y, what.find("moment") == std::string::npos ? 1e-4 : 1e-3, what);
            });
        });
    }
}

}  // namespace
}  // namespace gs::test
