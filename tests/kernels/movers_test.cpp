// SPDX-License-Identifier: Apache-2.0
// Steps that only visible Gaussians take, on the CPU and on its ranks.
#include "tests/kernels/movers.h"

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

TEST(Movers, ShareTheRegularisers) {
    for (const std::int64_t rows : {kRows, std::int64_t(3000)}) {
        const RankViews views(appearance_model("sh"), rows, rows / 3);
        expect_means_over_visible(*make_cpu_backend(views.model.appearance), views);
    }
}

TEST(Movers, ShareTheRegularisersOfAllRanks) {
    // A step of ranks on one view is that of one backend.
    const RankViews views(appearance_model("sh"), kRows, 60);
    StepRequest step = narrow_step(views, true);
    step.opacity_reg = step.scale_reg = 0.5f;
    const auto plain = make_cpu_backend(views.model.appearance);
    plain->upload(views.model);
    plain->step(step);
    Gaussians one = plain->download(true);
    for (const int ranks : {1, 2, 3}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(ranks, 1, views.model.appearance, views.targets(), [&](RankedBackend& backend) {
            backend.upload(views.model);
            backend.step_on({step});
            Gaussians after = backend.download(true);
            for (const Group group : {Group::kScale, Group::kOpacity})
                expect_close(one[group].m, after[group].m, 1e-5, kGroupNames[int(group)]);
        });
    }
}

TEST(Movers, ShareTheRegularisersOfSeveralViews) {
    const RankViews views(appearance_model("sh"), kRows, 60);
    for (const int ranks : {1, 3}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(ranks, kViews, views.model.appearance, views.targets(),
                            [&](RankedBackend& backend) { expect_mean_over_views(views, backend); });
    }
}

TEST(Movers, AreTheSameOnAnyNumberOfRanks) {
    const RankViews views(appearance_model("sh"), kRows, 60);
    Gaussians one;
    for (const int ranks : {1, 2, 3}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(ranks, kViews, views.model.appearance, views.targets(), [&](RankedBackend& backend) {
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
