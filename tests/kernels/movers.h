// SPDX-License-Identifier: Apache-2.0
// Steps that only visible Gaussians take, for every backend.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "kernels/optimizer/update_device.h"
#include "kernels/ranks/backend.h"
#include "tests/kernels/rank_views.h"

namespace gs::test {

/// The differences that residuals and their moments may have, relative to their values: a device steps whole warps of
/// them by other instructions.
struct Rounding {
    float parameters = 0, moments = 0;
};

/// Returns whether row i has the same parameters and moments in both models.
inline bool same_row(const Gaussians& a, const Gaussians& b, std::int64_t i, const Rounding& rounding = {}) {
    const auto same = [](float x, float y, float relative) {
        return std::abs(x - y) <= relative * std::max(std::abs(x), std::abs(y));
    };
    for (int g = 0; g < kNumGroups; ++g) {
        const auto &x = a.groups[g], &y = b.groups[g];
        const auto begin = std::size_t(i) * x.width, end = begin + x.width;
        if (end > x.param.size()) continue;  // it has no residual
        const Rounding of_group = g == int(Group::kResidual) ? rounding : Rounding{};
        for (auto k = begin; k < end; ++k)
            if (!same(x.param[k], y.param[k], of_group.parameters) || !same(x.m[k], y.m[k], of_group.moments) ||
                !same(x.v[k], y.v[k], of_group.moments))
                return false;
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

/// Expects that a step for visible Gaussians leaves all others as they are, and moves the visible ones, which have
/// missed none, as a step for all does. The backend repeats itself to the bit.
inline void expect_that_only_visible_move(Backend& backend, const RankViews& views, const Rounding& rounding = {}) {
    const Gaussians before = stepped_model(backend, views);
    const auto after_step = [&](bool only_visible) {
        StepRequest r = narrow_step(views, only_visible);
        r.rates.noise = 100;
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
        EXPECT_TRUE(shown ? same_row(all, visible, i, rounding) : same_row(before, visible, i));
        EXPECT_FALSE(same_row(before, all, i));
        ++(shown ? seen : unseen);
    }
    EXPECT_GT(seen, before.count / 20);
    EXPECT_GT(unseen, before.count / 20);
    EXPECT_EQ(visible.step, all.step);
}

/// Returns steps on the first views, narrow ones.
inline std::vector<StepRequest> narrow_steps(const RankViews& views, bool only_visible = true,
                                             std::size_t num_views = kViews) {
    std::vector<StepRequest> steps;
    for (std::size_t k = 0; k < num_views; ++k) {
        steps.push_back(narrow_step(views, only_visible, k));
        steps.back().loss.opacity_reg = steps.back().loss.scale_reg = 0.5f;
    }
    return steps;
}

/// Expects that a step on narrow views moves Gaussians that missed some as a step for all moves them from second
/// moments that are as much older, with as much of regularisers and noise. take(steps) takes one with `backend`.
template <class Take>
void expect_missed_steps(Backend& backend, const RankViews& views, std::size_t num_views, Take&& take,
                         double tolerance = 1e-5) {
    constexpr float kMissed[] = {0, 1, 40, 1e5};  // in views
    const auto noisy_steps = [&](bool only_visible) {
        auto steps = narrow_steps(views, only_visible, num_views);
        for (StepRequest& r : steps) r.rates.noise = 100;
        return steps;
    };
    Gaussians before = stepped_model(backend, views);
    before.step = 200000;
    Gaussians late = before;
    for (std::int64_t i = 0; i < late.count; ++i) late.last_step.push_back(float(late.step) - kMissed[i % 4]);
    backend.upload(late);
    take(noisy_steps(true));
    const Gaussians after = backend.download(true);
    ASSERT_EQ(std::int64_t(after.last_step.size()), before.count);
    for (std::int64_t k = 0; k < 4; ++k) {
        SCOPED_TRACE(std::to_string(kMissed[k]) + " missed views");
        const float missed = std::min(kMissed[k], kMostMissed), turns = 1 + missed / float(num_views);
        const double decay = std::pow(kAdamBeta2, double(missed));
        Gaussians older = before;
        for (auto& group : older.groups)
            for (float& v : group.v) v = float(v * decay);
        auto steps = noisy_steps(false);
        for (StepRequest& r : steps)
            r.loss.opacity_reg *= turns, r.loss.scale_reg *= turns, r.rates.noise *= std::sqrt(turns);
        backend.upload(older);
        take(steps);
        const Gaussians want = backend.download(true);
        EXPECT_TRUE(want.last_step.empty());
        const auto moved = [&](const Gaussians& model, const std::vector<float>& values, int width) {
            std::vector<float> out;
            for (std::int64_t i = k; i < model.count && std::size_t((i + 1) * width) <= values.size(); i += 4)
                if (after.gradient_count[std::size_t(i)] > 0)
                    out.insert(out.end(), values.begin() + i * width, values.begin() + (i + 1) * width);
            return out;
        };
        for (int g = 0; g < kNumGroups; ++g) {
            const auto &a = want.groups[g], &b = after.groups[g];
            for (const auto& [x, y] : {std::pair{&a.param, &b.param}, {&a.m, &b.m}, {&a.v, &b.v}})
                expect_close(moved(want, *x, a.width), moved(after, *y, a.width), tolerance, kGroupNames[g]);
        }
        EXPECT_GT(moved(after, after.last_step, 1).size(), std::size_t(before.count / 80));
        for (std::int64_t i = k; i < after.count; i += 4)
            EXPECT_EQ(after.last_step[std::size_t(i)],
                      after.gradient_count[std::size_t(i)] > 0 ? float(after.step) : late.last_step[std::size_t(i)]);
    }
}

/// Expects that a step whose loss is not finite changes nothing, and counts as missed.
inline void expect_that_a_skipped_step_is_missed(Backend& backend, const RankViews& views) {
    const Gaussians before = stepped_model(backend, views);
    backend.upload(before);
    StepRequest broken = narrow_step(views, true);
    broken.background.x = std::numeric_limits<float>::quiet_NaN();
    backend.step(broken);
    const Gaussians after = backend.download(true);
    EXPECT_EQ(after.step, before.step + 1);
    for (std::int64_t i = 0; i < before.count; ++i) EXPECT_TRUE(same_row(before, after, i)) << i;
    backend.step(narrow_step(views, true));
    const Gaussians late = backend.download(true);
    Gaussians missed = before;
    missed.step = before.step + 1;
    missed.last_step.assign(std::size_t(before.count), float(before.step));
    backend.upload(missed);
    backend.step(narrow_step(views, true));
    const Gaussians want = backend.download(true);
    for (std::int64_t i = 0; i < before.count; ++i) EXPECT_TRUE(same_row(want, late, i)) << i;
    EXPECT_EQ(want.last_step, late.last_step);
}

/// Takes three steps for visible Gaussians on narrow views, and expects that those which no view ever showed stayed.
inline Gaussians train_visible(const RankViews& views, Backend& backend) {
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
