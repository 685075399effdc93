// SPDX-License-Identifier: Apache-2.0
// The search for a PSNR, on a scene that is a formula: more steps and more Gaussians give more.
#include "lib/train/target_search.h"

#include <gtest/gtest.h>

#include <cmath>

namespace gs {
namespace {

/// Plays a search whose models have the PSNR of a formula.
struct Played {
    TargetOutcome outcome;
    std::int64_t steps = 0, count = 0, most_count = 0, segments = 0;

    double psnr() const { return 20 + 1.2 * std::log2(double(steps) / 1000) + 0.9 * std::log2(double(count) / 1000); }

    Played(double target, std::int64_t most_steps, std::int64_t cap, std::int64_t first = 10000) : count(first) {
        TargetSearch search(target, 20, most_steps, cap);
        std::int64_t kept_count = 0;
        const auto follow = [&](const ScheduleSegment& segment) {
            EXPECT_GT(segment.steps, 0);
            EXPECT_LT(++segments, 40) << "does not end";
            steps += segment.steps;
            count = std::max(count, segment.most_gaussians);  // growth takes what it may
            EXPECT_LE(count, std::max(first, cap));
            most_count = std::max(most_count, count);
        };
        follow(search.first(0, count));
        while (segments < 40) {
            const TargetStep step = search.next({steps, count, psnr()});
            if (step.keep) kept_count = count;
            if (step.restore) count = kept_count;
            if (step.segment.steps == 0) break;
            if (step.prune_to > 0) {
                EXPECT_LT(step.prune_to, count) << "a smaller model";
                count = step.prune_to;
            }
            follow(step.segment);
        }
        outcome = search.outcome();
    }
};

TEST(TargetSearch, EndsAtTheSmallestModelThatIsNearAboveTheTarget) {
    for (const double target : {21.0, 24.0, 26.5, 29.0, 31.0}) {
        const Played played(target, 30000, 1000000);
        EXPECT_TRUE(played.outcome.reached) << target;
        EXPECT_GE(played.outcome.psnr, target);
        EXPECT_LE(played.outcome.psnr, target + 0.15) << target;
        EXPECT_EQ(played.outcome.count, played.count) << "the model that the run ends with";
        EXPECT_EQ(played.outcome.measurements, played.segments);
    }
}

TEST(TargetSearch, LowTargetsTakeFewStepsAndFewGaussians) {
    const Played low(22, 30000, 1000000), high(30, 30000, 1000000);
    EXPECT_LT(low.steps, 5000);
    EXPECT_LT(low.most_count, high.most_count);
    EXPECT_LT(low.count, high.count);
}

TEST(TargetSearch, GivesUpEarlyWithAnEstimate) {
    const Played played(60, 30000, 100000);
    EXPECT_FALSE(played.outcome.reached);
    EXPECT_EQ(played.steps, 2000) << "two measurements say what a doubling gives";
    EXPECT_GT(played.outcome.estimate, played.outcome.psnr);
    EXPECT_LT(played.outcome.estimate, 60);
    EXPECT_NE(played.outcome.verdict.find("30000 iterations would reach about"), std::string::npos)
        << played.outcome.verdict;
}

TEST(TargetSearch, TheFirstTrainingSeesEveryViewOftenEnough) {
    EXPECT_EQ(TargetSearch(30, 20, 30000, 100000).first(0, 100).steps, 1000);
    EXPECT_EQ(TargetSearch(30, 200, 30000, 100000).first(0, 100).steps, 6000) << "thirty times";
    EXPECT_EQ(TargetSearch(30, 200, 5000, 100000).first(0, 100).steps, 5000) << "all that there are";
    EXPECT_EQ(TargetSearch(30, 200, 30000, 100000).first(0, 100).most_gaussians, 100000);
    EXPECT_EQ(TargetSearch(30, 200, 30000, 100000).first(6000, 100).steps, 0);
}

TEST(TargetSearch, TrainsToTheLastStepWhereThereIsHope) {
    TargetSearch search(29.2, 20, 30000, 100000);
    EXPECT_EQ(search.next({14000, 100000, 28}).segment.steps, 14000);
    EXPECT_EQ(search.next({28000, 100000, 29}).segment.steps, 2000);
    EXPECT_EQ(search.next({30000, 100000, 29.1}).segment.steps, 0);
    const TargetOutcome outcome = search.outcome();
    EXPECT_FALSE(outcome.reached);
    EXPECT_EQ(outcome.psnr, 29.1);
    EXPECT_NE(outcome.verdict.find("30000 iterations are all"), std::string::npos) << outcome.verdict;
}

TEST(TargetSearch, NoModelIsEmpty) {
    const Played played(1, 30000, 1000000);
    EXPECT_TRUE(played.outcome.reached);
    EXPECT_LE(played.count, (50000 >> 12) + 1) << "halved as often as a search may";
    TargetSearch search(1, 20, 30000, 1000000);
    const TargetStep step = search.next({1000, 2, 9});
    EXPECT_EQ(step.prune_to, 1);
    EXPECT_EQ(search.next({1200, 1, 8}).prune_to, 0);
    EXPECT_EQ(search.outcome().count, 1);
    const Played one(5, 1, 1, 1);
    EXPECT_EQ(one.steps, 1);
    EXPECT_FALSE(one.outcome.reached) << one.outcome.psnr;
}

TEST(TargetSearch, AModelThatRecoversLateIsTriedAgain) {
    TargetSearch search(30, 20, 30000, 100000);
    TargetStep step = search.next({1000, 10000, 30.8});
    EXPECT_TRUE(step.keep);
    EXPECT_EQ(step.prune_to, 5000) << "0.8 dB more than are needed";
    step = search.next({1200, 5000, 29.9});
    EXPECT_TRUE(step.restore);
    EXPECT_GT(step.prune_to, 5000);
    step = search.next({1400, 5100, 30.4});  // better than the smaller one by more than its size explains
    EXPECT_TRUE(step.keep);
    EXPECT_LT(step.prune_to, 5000) << "what fell below had fewer steps";
}

TEST(TargetSearch, AResumedRunGoesOnFromWhatItHas) {
    TargetSearch search(30, 20, 30000, 100000);
    EXPECT_EQ(search.first(0, 100).from, 0);
    EXPECT_EQ(search.first(250, 100).steps, 750) << "what is left of the first training";
    EXPECT_EQ(search.first(250, 100).from, 7500);
    EXPECT_EQ(search.first(250, 100).most_gaussians, search.first(0, 100).most_gaussians);
    EXPECT_EQ(search.first(1000, 100).steps, 0);
    EXPECT_EQ(search.first(7000, 100).steps, 0);
    const TargetStep below = search.next({7000, 50000, 28});
    EXPECT_EQ(below.segment.steps, 7000);
    EXPECT_EQ(below.prune_to, 0);
    EXPECT_GT(below.segment.from, 0) << "rates do not begin anew";
    const TargetStep end = search.next({30000, 100000, 29});
    EXPECT_EQ(end.segment.steps, 0);
}

}  // namespace
}  // namespace gs
