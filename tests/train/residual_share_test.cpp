// SPDX-License-Identifier: Apache-2.0
// Who keeps a residual, and runs in which some lose it.
#include "lib/train/residual_share.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iterator>
#include <limits>
#include <set>

#include "kernels/base/error.h"
#include "lib/model/appearance_spec.h"
#include "tests/kernels/forwarding_engine.h"

namespace gs {
namespace {

const AppearanceSpec kSh{"sh", 3, ColorActivation::kRelu};

constexpr float kInvisible = -100;

/// Gaussians whose worth is given, and whose error grows by what the lost residuals were worth.
class Worthy : public test::ForwardingEngine {
  public:
    explicit Worthy(std::vector<float> worth) : ForwardingEngine(kSh), worth_(std::move(worth)) {}
    RowCounts counts() const override { return {std::int64_t(worth_.size()), kept_}; }
    std::optional<ResidualScores> residual_scores(std::size_t num_views, const StepSource& step_on) override {
        for (std::size_t v = 0; v < num_views; ++v) step_on(v);
        return ResidualScores{worth_, std::vector<float>(3 * worth_.size())};
    }
    double half_squared_error(const StepRequest&, const SplatParts&) override {
        double lost = 0;
        for (std::int64_t i = kept_; i < std::int64_t(worth_.size()); ++i)
            lost += std::isnan(worth_[i]) ? 0 : double(worth_[i]);
        return 100 + lost;
    }
    void keep_residuals(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) override {
        EXPECT_EQ(bases.size(), 3 * worth_.size());
        std::vector<float> kept, lost;
        for (std::size_t i = 0; i < marks.size(); ++i) (marks[i] ? kept : lost).push_back(worth_[i]);
        kept_ = std::int64_t(kept.size());
        kept.insert(kept.end(), lost.begin(), lost.end());
        worth_ = kept;
    }
    PruneStats prune(const PruneRequest& request) override {
        EXPECT_TRUE(std::holds_alternative<InvisibleRows>(request));
        PruneStats stats;
        stats.removed = std::int64_t(std::erase(worth_, kInvisible));
        kept_ -= stats.removed;
        return stats;
    }
    std::vector<float> kept() const { return {worth_.begin(), worth_.begin() + kept_}; }

  private:
    std::vector<float> worth_;
    std::int64_t kept_ = std::int64_t(worth_.size());
};

constexpr double kLast = kResidualStages[std::size(kResidualStages) - 1];

struct Chosen {
    std::optional<ResidualChange> change;
    std::vector<float> kept;
};

Chosen choose(std::optional<double> share, std::vector<float> worth, double tolerance = 0.1, double position = kLast) {
    TrainOptions options;
    options.appearance_share = share, options.auto_tolerance = tolerance;
    Scene scene;
    scene.train.resize(3);
    test::BackendOf<Worthy> backend(std::move(worth));
    const ResidualShare residuals(options, kSh, scene);
    const auto change = residuals.before_step(backend, {.iteration = 9, .position = position, .before = position - 1},
                                              [](std::size_t) { return StepRequest{}; });
    return {change, backend->kept()};
}

const std::vector<float> kWorth = {3, 1, 4, 1, 5, 9, 2, 6, 5, 3};

TEST(ResidualShare, KeepsTheMostWorthyInTheirOrder) {
    const Chosen chosen = choose(0.4, kWorth);
    ASSERT_TRUE(chosen.change);
    EXPECT_EQ(chosen.change->before, 10);
    EXPECT_EQ(chosen.change->after, 4);
    EXPECT_EQ(chosen.kept, (std::vector<float>{5, 9, 6, 5}));
}

TEST(ResidualShare, ComesInStagesByEqualFactors) {
    const std::vector<float> worth(10000, 1.0f);
    double share = 1;
    for (const double stage : kResidualStages) {
        share *= std::pow(0.4, 1.0 / std::size(kResidualStages));
        const Chosen chosen = choose(0.4, worth, 0.1, stage);
        ASSERT_TRUE(chosen.change);
        EXPECT_NEAR(double(chosen.change->after), 10000 * share, 1);
        EXPECT_FALSE(choose(0.4, worth, 0.1, stage - 1).change);
        EXPECT_FALSE(choose(0.4, worth, 0.1, stage + 1).change);
    }
    EXPECT_FALSE(choose(1, worth).change) << "all";
}

TEST(ResidualShare, OfSeveralStagesAtOnceTheLastCounts) {
    TrainOptions options;
    options.appearance_share = 0.4;
    Scene scene;
    scene.train.resize(3);
    test::BackendOf<Worthy> backend(kWorth);
    const ResidualShare residuals(options, kSh, scene);
    const auto change = residuals.before_step(backend, {.iteration = 9, .position = 29000, .before = 0},
                                              [](std::size_t) { return StepRequest{}; });
    ASSERT_TRUE(change);
    EXPECT_EQ(change->after, 4);
}

TEST(ResidualShare, AWorthThatIsNoNumberGoesFirst) {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    EXPECT_EQ(choose(0.5, {nan, 1, -2, nan}).kept, (std::vector<float>{1, -2}));
    EXPECT_EQ(choose(0, {nan, 1}).kept, std::vector<float>{});
    EXPECT_EQ(choose(0.5, {}).kept, std::vector<float>{});
}

TEST(ResidualShare, IsAShareOfWhatCanBeSeen) {
    std::vector<float> worth = kWorth;
    worth.insert(worth.begin() + 3, 10, kInvisible);
    const Chosen chosen = choose(0.4, worth);
    EXPECT_EQ(chosen.change->pruned, 10);
    EXPECT_EQ(chosen.change->before, 10);
    EXPECT_EQ(chosen.kept, (std::vector<float>{5, 9, 6, 5}));
}

TEST(ResidualShare, AutoGoesOnUntilTheLossReachesAQuarterOfTheTolerance) {
    std::vector<float> worth(1000);
    for (int i = 0; i < 1000; ++i) worth[std::size_t(i)] = i < 200 ? 1.0f : 0.0002f;
    const std::optional<double> automatic;
    const Chosen chosen = choose(automatic, worth, 0.1);
    ASSERT_TRUE(chosen.change);
    EXPECT_EQ(chosen.change->after, std::int64_t(chosen.kept.size()));
    EXPECT_LT(chosen.change->after, 200) << "losing one of the worthy costs 0.04 dB";
    EXPECT_GE(chosen.change->after, 175) << "the next step of the search";
    EXPECT_GE(chosen.change->loss, 0.025);
    EXPECT_EQ(choose(automatic, worth, 0).change->after, 350) << "whatever it costs";
    EXPECT_EQ(choose(automatic, std::vector<float>(100, 0.0f)).change->after, 0) << "nothing is worth anything";
    EXPECT_EQ(choose(automatic, std::vector<float>(100, 50.0f)).change->after, 35) << "everything is";
    EXPECT_EQ(choose(automatic, {1}).change->after, 0);
}

TEST(ResidualShare, AtTheEndItIsAShareOfWhatIsLeft) {
    TrainOptions options;
    Scene scene;
    scene.train.resize(3);
    const auto at_end = [&](std::optional<double> share) {
        options.appearance_share = share;
        test::BackendOf<Worthy> backend(kWorth);
        const auto change =
            ResidualShare(options, kSh, scene).at_end(backend, [](std::size_t) { return StepRequest{}; });
        return std::pair(change ? change->after : -1, backend->kept());
    };
    EXPECT_EQ(at_end(0.4), std::pair(std::int64_t(4), std::vector<float>{5, 9, 6, 5}));
    EXPECT_EQ(at_end(1).first, -1) << "all";
    EXPECT_EQ(at_end({}).first, 4) << "auto keeps 35 % of ten, whatever it costs";
}

TEST(ResidualShare, AllViewsSayWhatGoesAtTheEnd) {
    // What only one of many views shows is worth nothing to the others, and nothing makes up for it after the end.
    TrainOptions options;
    options.appearance_share = 0.4;
    Scene scene;
    scene.train.resize(500);
    std::set<std::size_t> seen;
    test::BackendOf<Worthy> backend(kWorth);
    const ResidualShare share(options, kSh, scene);
    share.at_end(backend, [&](std::size_t view) {
        seen.insert(view);
        return StepRequest{};
    });
    EXPECT_EQ(seen.size(), 500u);
    EXPECT_EQ(share.views_at_end(), 500u) << "what a time limit counts on";
}

TEST(ResidualShare, BytesAreAnotherWayToSayIt) {
    TrainOptions options;
    EXPECT_EQ(wanted_residual_share(options, kSh), 1);
    options.appearance_bytes = 12 + 45;
    EXPECT_DOUBLE_EQ(*wanted_residual_share(options, kSh), 0.25);
    options.appearance_bytes = 12;
    EXPECT_EQ(wanted_residual_share(options, kSh), 0);
    options.appearance_bytes = 1e6;
    EXPECT_EQ(wanted_residual_share(options, kSh), 1);
    EXPECT_EQ(wanted_residual_share(options, {"none", 0, ColorActivation::kRelu}), 1);
    options.appearance_bytes = 11;
    EXPECT_THROW(wanted_residual_share(options, kSh), UsageError);
    options.appearance_bytes.reset(), options.appearance_share.reset();
    EXPECT_FALSE(wanted_residual_share(options, kSh));
}

}  // namespace
}  // namespace gs
