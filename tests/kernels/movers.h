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

/// Returns a step on a view that shows a part of the Gaussians, with the statistic of ADC.
inline StepRequest narrow_step(const RankViews& views, bool only_visible, std::size_t view = 0) {
    StepRequest r = views.step(view);
    r.camera.fx *= 6, r.camera.fy *= 6;
    r.gather_gradient_stats = true;
    r.only_visible = only_visible;
    return r;
}

/// Returns the model after two steps, so that all Gaussians have moments. Its statistic of ADC is 0.
inline Gaussians stepped_model(Backend& backend, const RankViews& views) {
    backend.upload(views.model);
    for (int k = 0; k < 2; ++k) backend.step(views.step(0));
    Gaussians model = backend.download(true);
    model.gradient_sum.assign(model.count, 0.0f), model.gradient_count.assign(model.count, 0.0f);
    return model;
}

/// Expects that a step for visible Gaussians leaves all others as they are, and moves the visible ones as a step for
/// all does, but for the regularisers. The backend repeats itself to the bit; `rounded` as in same_row.
inline void expect_that_only_visible_move(Backend& backend, const RankViews& views, bool rounded = false) {
    const Gaussians before = stepped_model(backend, views);
    const auto after_step = [&](bool only_visible) {
        StepRequest r = narrow_step(views, only_visible);
        r.opacity_reg = r.scale_reg = 0;
        r.noise = 100;
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

/// Expects that the regularisers of a step for visible Gaussians are means over these: their moments are those of a
/// step for all N, with weights that are higher by N over the number of visible ones.
inline void expect_means_over_visible(Backend& backend, const RankViews& views) {
    const Gaussians before = stepped_model(backend, views);
    const auto after_step = [&](bool only_visible, float weight) {
        StepRequest r = narrow_step(views, only_visible);
        r.opacity_reg = r.scale_reg = weight;
        backend.upload(before);
        backend.step(r);
        return backend.download(true);
    };
    const Gaussians visible = after_step(true, 0.5f);
    const auto num_visible = std::count(visible.gradient_count.begin(), visible.gradient_count.end(), 1.0f);
    const float factor = float(before.count) / float(num_visible);
    const Gaussians all = after_step(false, 0.5f * factor), unscaled = after_step(false, 0.5f);
    for (const Group group : {Group::kScale, Group::kOpacity}) {
        SCOPED_TRACE(kGroupNames[int(group)]);
        const auto of_visible = [&](const Gaussians& model) {
            const auto& g = model[group];
            std::vector<float> out;
            for (std::size_t k = 0; k < g.m.size(); ++k)
                if (visible.gradient_count[k / std::size_t(g.width)] > 0) out.push_back(g.m[k]);
            return out;
        };
        expect_close(of_visible(all), of_visible(visible), 1e-5, "first moment");
        EXPECT_GT(largest_difference(of_visible(unscaled), of_visible(visible)), 1e-3) << "the weight shows";
    }
}

/// Returns steps on all views, narrow ones, for visible Gaussians.
inline std::vector<StepRequest> narrow_steps(const RankViews& views) {
    std::vector<StepRequest> steps;
    for (std::size_t k = 0; k < kViews; ++k) {
        steps.push_back(narrow_step(views, true, k));
        steps.back().opacity_reg = steps.back().scale_reg = 0.5f;
    }
    return steps;
}

/// Expects that a step for visible Gaussians on several views has the mean of what each view gives, regularisers
/// included.
inline void expect_mean_over_views(const RankViews& views, RankedBackend& backend, double tolerance = 1e-5) {
    const auto steps = narrow_steps(views);
    const Gaussians sum = sum_of_steps(views.model, steps);
    backend.upload(views.model);
    backend.step_on(steps);
    const Gaussians after = backend.download(true);
    for (const Group group : {Group::kScale, Group::kOpacity}) {
        std::vector<float> a = sum[group].m, b = after[group].m;
        for (float& m : a) m *= mean_of_moments(steps.size());
        for (float& m : b) m *= gradient_of_moment(steps.size());
        expect_close(a, b, tolerance, kGroupNames[int(group)]);
    }
}

/// Takes three steps for visible Gaussians on narrow views, and expects that those which no view ever showed stayed.
inline Gaussians train_visible(const RankViews& views, RankedBackend& backend) {
    backend.upload(views.model);
    for (int k = 0; k < 3; ++k) {
        backend.step_on(narrow_steps(views));
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
