// SPDX-License-Identifier: Apache-2.0
// Steps that only visible Gaussians take, for every backend.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "kernels/backend.h"
#include "kernels/ranks/ranked_backend.h"
#include "tests/kernels/rank_views.h"

namespace gs::test {

/// Returns whether row i has the same parameters and moments in both models. Residuals may differ by a rounding where
/// `rounded`: a device steps whole warps of them by other instructions.
inline bool same_row(const Gaussians& a, const Gaussians& b, std::int64_t i, bool rounded = false) {
    const auto same = [&](float x, float y) {
        return x == y || (rounded && std::abs(x - y) <= 1e-5f * std::max(std::abs(x), std::abs(y)));
    };
    for (int g = 0; g < kNumGroups; ++g) {
        const auto &x = a.groups[g], &y = b.groups[g];
        const auto begin = std::size_t(i) * x.width, end = begin + x.width;
        if (end > x.param.size()) continue;  // it has no residual
        for (const auto& [p, q] : {std::pair{&x.param, &y.param}, {&x.m, &y.m}, {&x.v, &y.v}})
            for (auto k = begin; k < end; ++k)
                if (g == int(Group::kResidual) ? !same((*p)[k], (*q)[k]) : (*p)[k] != (*q)[k]) return false;
    }
    return true;
}

/// Returns a step on a view that shows a part of the Gaussians, with regularisers, noise and the statistic of ADC.
inline StepRequest narrow_step(const RankViews& views) {
    StepRequest r = views.step(0);
    r.camera.fx *= 6, r.camera.fy *= 6;
    r.gather_gradient_stats = true;
    r.noise = 100;
    return r;
}

/// Expects that a step for visible Gaussians leaves all others as they are, and moves the visible ones as a step for
/// all does. The backend repeats itself to the bit; `rounded` as in same_row.
inline void expect_that_only_visible_move(Backend& backend, const RankViews& views, bool rounded = false) {
    backend.upload(views.model);
    for (int k = 0; k < 2; ++k) backend.step(views.step(0));  // so that all have moments
    Gaussians before = backend.download(true);
    before.gradient_sum.assign(before.count, 0.0f), before.gradient_count.assign(before.count, 0.0f);
    const auto after_step = [&](bool only_visible) {
        StepRequest r = narrow_step(views);
        r.only_visible = only_visible;
        backend.upload(before);
        backend.step(r);
        return backend.download(true);
    };
    const Gaussians all = after_step(false), visible = after_step(true);
    int seen = 0, unseen = 0;
    for (std::int64_t i = 0; i < before.count; ++i) {
        SCOPED_TRACE("Gaussian " + std::to_string(i));
        const bool shown = all.gradient_count[i] > 0;
        EXPECT_EQ(shown, visible.gradient_count[i] > 0);
        EXPECT_TRUE(shown ? same_row(all, visible, i, rounded) : same_row(before, visible, i));
        EXPECT_FALSE(same_row(before, all, i));
        ++(shown ? seen : unseen);
    }
    EXPECT_GT(seen, before.count / 20);
    EXPECT_GT(unseen, before.count / 20);
    EXPECT_EQ(visible.step, all.step);
}

/// Takes three steps for visible Gaussians on narrow views, and expects that those which no view ever showed stayed.
inline Gaussians train_visible(const RankViews& views, RankedBackend& backend) {
    backend.upload(views.model);
    for (int k = 0; k < 3; ++k) {
        auto steps = views.steps();
        for (StepRequest& r : steps) {
            r.camera.fx *= 6, r.camera.fy *= 6;
            r.only_visible = true;
        }
        steps[0].gather_gradient_stats = true;
        backend.step_on(steps);
    }
    const Gaussians after = backend.download(true);
    int unseen = 0;
    for (std::int64_t i = 0; i < after.count; ++i)
        if (after.gradient_count[i] == 0) {
            ++unseen;
            EXPECT_TRUE(same_row(views.model, after, i)) << i;
        }
    EXPECT_GT(unseen, 5);
    EXPECT_LT(unseen, after.count - 5);
    return after;
}

}  // namespace gs::test
