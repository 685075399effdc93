// SPDX-License-Identifier: Apache-2.0
// At which iterations the schedule prunes by score, in which order, and that resuming does not change it.
#include "lib/train/densification.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <utility>

#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "tests/kernels/forwarding_engine.h"

namespace gs {
namespace {

/// Writes down every request and does nothing.
class Watched : public test::ForwardingEngine {
  public:
    Watched() : ForwardingEngine({}) {}
    std::int64_t iteration = 0;
    std::vector<std::pair<std::int64_t, double>> prunings;  ///< iteration, share of the rows
    std::vector<std::string> at_9000;
    std::vector<std::int64_t> sorts;
    std::int64_t grows_until = 0;
    std::size_t num_views = 0;

    RowCounts counts() const override { return {count, 0}; }
    void set_active_degree(int) override {}
    DensifyStats densify(const DensifyRequest& request) override {
        if (std::holds_alternative<MortonOrder>(request.rule)) return sorts.push_back(iteration), DensifyStats{};
        const bool resets = std::holds_alternative<OpacityReset>(request.rule);
        note(resets ? "reset" : "densify");
        if (resets) return {};
        return {.relocated = 1, .added = iteration < grows_until ? 1 : 0, .count = count};
    }
    std::optional<std::vector<float>> scores(const std::vector<RenderRequest>& views) override {
        num_views = views.size();
        std::vector<float> values(static_cast<std::size_t>(count));
        std::iota(values.begin(), values.end(), 1.0f);
        return values;
    }
    PruneStats prune(const PruneRequest& request) override {
        note("prune");
        const double before = double(std::exchange(count, std::int64_t(std::get<AllBut>(request).rows.size())));
        prunings.push_back({iteration, std::round(10 - 10 * double(count) / before) / 10});
        return {};
    }
    std::int64_t count = 100000;

  private:
    void note(const char* what) {
        if (iteration == 9000) at_9000.push_back(what);
    }
};

TrainOptions speedy_options() {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.strategy = Strategy::kAdc, o.speedy_splat = true;
    return o;
}

/// Makes all calls of a whole training. Returns the numbers of Gaussians that before_step and
/// after_step pruned by score.
std::pair<std::int64_t, std::int64_t> walk(TrainOptions o, test::BackendOf<Watched>& backend) {
    o = resolve(o);
    DensificationSchedule schedule(o, appearance_spec(o), 1, true, std::vector<RenderRequest>(3));
    backend.upload({});
    std::pair<std::int64_t, std::int64_t> pruned{0, 0};
    for (std::int64_t k = 0; k < o.iterations; ++k) {
        backend->iteration = k;
        pruned.first += schedule.before_step(backend, moment_at(o, k)).pruned_by_score;
        const ScheduledChange after = schedule.after_step(backend, moment_at(o, k));
        pruned.second += after.pruned_by_score;
        if (after.pruned_by_score) {
            EXPECT_EQ(after.count, backend->count);
        }
    }
    return pruned;
}

using Prunings = std::vector<std::pair<std::int64_t, double>>;

TEST(SpeedySchedule, IsTheOneOfTheSpec) {
    test::BackendOf<Watched> backend;
    EXPECT_EQ(walk(speedy_options(), backend), (std::pair<std::int64_t, std::int64_t>{99200, 666}));
    EXPECT_EQ(backend->prunings, (Prunings{{6000, 0.8},
                                           {9000, 0.8},
                                           {12000, 0.8},
                                           {15000, 0.3},
                                           {18000, 0.3},
                                           {21000, 0.3},
                                           {24000, 0.3},
                                           {27000, 0.3}}));
    EXPECT_EQ(backend->num_views, 3u);
    EXPECT_EQ(backend->at_9000, (std::vector<std::string>{"densify", "prune", "reset"}));
}

TEST(SpeedySchedule, FollowsTheEndOfDensificationAndOfTheRun) {
    test::BackendOf<Watched> backend;
    TrainOptions o = speedy_options();
    o.densify_until_iter = 9000, o.iterations = 15000, o.schedule = ScheduleKind::kFixed;
    walk(o, backend);
    EXPECT_EQ(backend->prunings, (Prunings{{6000, 0.8}, {9000, 0.8}, {12000, 0.3}}));
}

TEST(SpeedySchedule, IsSilentUnlessAskedFor) {
    test::BackendOf<Watched> backend;
    TrainOptions o = speedy_options();
    o.speedy_splat = false;
    walk(o, backend);
    EXPECT_TRUE(backend->prunings.empty());
}

/// Returns the iterations from `first` to `last`, `interval` apart.
std::vector<std::int64_t> every(std::int64_t interval, std::int64_t first, std::int64_t last) {
    std::vector<std::int64_t> all;
    for (std::int64_t k = first; k <= last; k += interval) all.push_back(k);
    return all;
}

TEST(MortonSchedule, FollowsGrowthAndThenGoesOnMoreSeldom) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    test::BackendOf<Watched> backend;
    backend->grows_until = 2950;
    walk(o, backend);
    std::vector<std::int64_t> expected = {0, 500};
    for (const auto& some : {every(100, 600, 2900), every(500, 3000, 25000)})
        expected.insert(expected.end(), some.begin(), some.end());
    EXPECT_EQ(backend->sorts, expected);
}

TEST(MortonSchedule, LeavesHundredStepsBetweenSortsOfAShortRun) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.iterations = 1000;
    test::BackendOf<Watched> backend;
    backend->grows_until = 1000;
    walk(o, backend);
    EXPECT_EQ(backend->sorts, every(100, 0, 800));
}

}  // namespace
}  // namespace gs
