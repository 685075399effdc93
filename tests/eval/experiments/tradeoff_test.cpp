// SPDX-License-Identifier: Apache-2.0
// Frontier, recommendations and the files of a trade-off, on made-up results.
#include "eval/experiments/tradeoff.h"

#include <gtest/gtest.h>
#include <limits>
#include <nlohmann/json.hpp>

#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

using Indices = std::vector<std::size_t>;
using Flags = std::vector<bool>;

class TradeoffFigures : public ::testing::Test {
  protected:
    TradeoffFigures() {
        tradeoff_.source = "builtin:glossy";
        tradeoff_.axes = {{"appearance", {"none", "nasg", "sh"}}, {"budget", {"0.1", "1"}}};
    }
    TradeoffRun& add(const std::string& appearance, const std::string& budget) {
        TradeoffRun run;
        run.configuration.values = {appearance, budget};
        run.configuration.options.model = "out/" + appearance + budget;
        tradeoff_.runs.push_back(run);
        return tradeoff_.runs.back();
    }
    void add(const std::string& appearance, const std::string& budget, double psnr, double train_seconds,
             double frame_seconds, std::int64_t bytes) {
        TradeoffRun& run = add(appearance, budget);
        run.state = RunState::kFinished;
        RunResult& result = run.result.emplace();
        result.psnr = psnr, result.ssim = psnr / 40, result.num_gaussians = 1000;
        result.train_seconds = train_seconds, result.frame_seconds = frame_seconds, result.bytes = bytes;
        result.protocol = {{"line", "protocol made up"}};
    }
    /// sh 1 is best; nasg 0.1 small and near; none 0.1 smallest and fastest, but far; none 1 dominated.
    void add_usual() {
        add("sh", "1", 30, 100, 0.010, 20'000'000);
        add("nasg", "0.1", 29.5, 50, 0.004, 2'000'000);
        add("none", "1", 28, 60, 0.005, 4'000'000);
        add("none", "0.1", 26, 40, 0.002, 1'000'000);
        add("sh", "0.1", 29.2, 110, 0.003, 5'000'000);
    }
    std::string text(const std::string& name) const {
        for (const Recommendation& r : recommend(tradeoff_))
            if (r.name == name) return r.text;
        return "missing";
    }
    Tradeoff tradeoff_;
};

TEST_F(TradeoffFigures, FrontierIsOrderedByQuality) {
    add_usual();
    add("nasg", "1").state = RunState::kNoTime;
    const Ranking ranking = rank_runs(tradeoff_);
    EXPECT_EQ(ranking.frontier, (Indices{0, 1, 4, 3}));
    EXPECT_EQ(ranking.dominated, (Indices{2}));
    EXPECT_EQ(promoted(tradeoff_, {2, 1}), (Indices{1}));
}

TEST_F(TradeoffFigures, RecommendationsSayWhatTheyGiveUp) {
    add_usual();
    EXPECT_EQ(text("best"),
              "appearance sh, budget 1 (30.00 dB, 20.0 MB, 100.0 FPS, trained in 1 min 40 s); costs 10 times the bytes "
              "of the smallest and 3.3 times the "
              "frame time of the fastest");
    EXPECT_EQ(text("smallest"),
              "appearance nasg, budget 0.1 (29.50 dB, 2.00 MB, 250.0 FPS, trained in 50.0 s); gives up 0.50 dB against "
              "the best, and is "
              "10 times smaller, 2.0 times faster to train, 2.5 times faster to render");
    EXPECT_EQ(text("fastest"),
              "appearance sh, budget 0.1 (29.20 dB, 5.00 MB, 333.3 FPS, trained in 1 min 50 s); gives up 0.80 dB "
              "against the best, and is "
              "4.0 times smaller, 1.1 times slower to train, 3.3 times faster to render");
    tradeoff_.give_up = 10;
    EXPECT_EQ(recommend(tradeoff_)[1].run, 3u);
    EXPECT_EQ(recommend(tradeoff_)[2].run, 3u);
    EXPECT_EQ(text("fastest"),
              "the smallest itself; nothing within 10.00 dB of the best is faster to render by more than 5 %");
    tradeoff_.give_up = 0;
    EXPECT_EQ(text("smallest"), "the best itself; nothing within 0.00 dB of the best is smaller by more than 5 %");
    EXPECT_EQ(text("fastest"),
              "the best itself; nothing within 0.00 dB of the best is faster to render by more than 5 %");
    EXPECT_NE(text("best").find("gives up nothing"), std::string::npos);
}

TEST_F(TradeoffFigures, NothingIsGivenUpForAFewPercent) {
    add("sh", "1", 30, 100, 0.010, 1'000'000);
    add("nasg", "1", 29.5, 100, 0.009, 960'000);
    EXPECT_EQ(recommend(tradeoff_)[1].run, 0u);
    EXPECT_EQ(recommend(tradeoff_)[2].run, 1u) << "a tenth of the frame time";
}

TEST_F(TradeoffFigures, SsimDecidesWhereItIsAskedFor) {
    add_usual();
    tradeoff_.runs[1].result->ssim = 0.99;
    tradeoff_.quality = Quality::kSsim, tradeoff_.give_up = 0.02;
    EXPECT_EQ(recommend(tradeoff_)[0].run, 1u);
    EXPECT_NE(text("best").find("(SSIM 0.9900, "), std::string::npos) << text("best");
    EXPECT_NE(text("fastest").find("0.0200 SSIM"), std::string::npos) << text("fastest");
}

TEST_F(TradeoffFigures, APerfectScoreHasWordsAndNoPlaceInPlots) {
    add_usual();
    tradeoff_.runs[0].result->psnr = std::numeric_limits<double>::infinity();
    EXPECT_NE(text("best").find("inf dB"), std::string::npos);
    EXPECT_EQ(recommend(tradeoff_)[1].run, 0u) << "nothing is near it";
    EXPECT_EQ(tradeoff_page(tradeoff_).find("nan"), std::string::npos);
    EXPECT_TRUE(parse_json(tradeoff_json(tradeoff_))["runs"][0]["PSNR"].is_null());
}

TEST_F(TradeoffFigures, TextNamesEveryConfiguration) {
    add_usual();
    TradeoffRun& failed = add("nasg", "1");
    failed.state = RunState::kFailed, failed.error = "disk\nfull";
    add("none", "0.5").state = RunState::kNoTime;
    add("none", "0.6").state = RunState::kStopped;
    add("none", "0.7");
    tradeoff_.remarks = {"A remark."};
    const std::string text = format_tradeoff(tradeoff_);
    for (const char* part :
         {"| sh         | 1      | optimal: best     |", "| nasg       | 0.1    | optimal: smallest |",
          "| none       | 1      | dominated         |", "- **fastest**: appearance sh, budget 0.1", "\nA remark.\n",
          "seed 0", "\nprotocol made up\n", "- appearance nasg, budget 1: failed: disk full\n",
          "- appearance none, budget 0.5: not started: would not have ended in time\n",
          "- appearance none, budget 0.6: stopped at the time limit\n", "- appearance none, budget 0.7: not reached\n"})
        EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
    EXPECT_LT(text.find("| none       | 0.1    |"), text.find("| none       | 1      |"))
        << "the dominated ones come last";
}

TEST_F(TradeoffFigures, PageHasAPlotForEachCostWithEveryRun) {
    add_usual();
    const auto count = [](const std::string& text, const std::string& part) {
        std::size_t n = 0;
        for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++n;
        return n;
    };
    std::string page = tradeoff_page(tradeoff_);
    EXPECT_EQ(count(page, "<svg"), 3u) << "nobody measured memory";
    EXPECT_EQ(count(page, "<circle cx"), 15u);
    EXPECT_EQ(count(page, "<circle class=\"ring\""), 9u) << "three recommendations";
    EXPECT_EQ(count(page, "<g class=\"dominated\">"), 3u) << "without labels";
    EXPECT_EQ(count(page, "<tr class=\"grey\">"), 1u);
    EXPECT_EQ(count(page, "<polyline class=\"front\""), 3u);
    EXPECT_TRUE(page.ends_with("</html>\n"));
    tradeoff_.runs[0].result->peak_device_bytes = 1 << 30;
    tradeoff_.axes[0].values[2] = tradeoff_.runs[0].configuration.values[0] = "<sh>";
    page = tradeoff_page(tradeoff_);
    EXPECT_EQ(count(page, "<svg"), 4u);
    EXPECT_EQ(count(page, "<sh>"), 0u);
    EXPECT_NE(format_tradeoff(tradeoff_).find("1.00 GiB"), std::string::npos);
}

TEST_F(TradeoffFigures, FilesAreWrittenEvenWithoutAResult) {
    test::TemporaryFolder folder;
    add("none", "1");
    write_tradeoff(folder.path() / "new", tradeoff_);
    const auto json = parse_json(read_input(folder.path() / "new/tradeoff.json"));
    EXPECT_EQ(json["runs"][0]["status"], "not reached");
    EXPECT_EQ(json["runs"][0]["values"]["appearance"], "none");
    EXPECT_TRUE(json["recommendations"].empty());
    for (const char* name : {"new/tradeoff.md", "new/tradeoff.html"})
        EXPECT_TRUE(std::filesystem::exists(folder.path() / name));
    EXPECT_NE(tradeoff_page(tradeoff_).find("No configuration was trained"), std::string::npos);
}

TEST(Pareto, DominanceNeedsNoWorseInAllAndBetterInOne) {
    EXPECT_TRUE(dominates({1, 2, 3, 4}, {1, 2, 3, 5}));
    EXPECT_FALSE(dominates({1, 2, 3, 4}, {1, 2, 3, 4}));
    EXPECT_FALSE(dominates({0, 2, 3, 5}, {1, 2, 3, 4}));
    EXPECT_FALSE(dominates({1, 2, 3, 5}, {1, 2, 3, 4}));
}

TEST(Pareto, FrontHasWhatNobodyDominates) {
    EXPECT_EQ(pareto_front({}), Flags{});
    EXPECT_EQ(pareto_front({{-30, 9, 9, 9}}), Flags{true});
    // Best, cheapest, beaten by both neighbours, twice the same, worse than these.
    EXPECT_EQ(
        pareto_front({{-30, 9, 1, 1}, {-20, 1, 1, 1}, {-19, 9, 2, 2}, {-25, 4, 1, 1}, {-25, 4, 1, 1}, {-25, 5, 1, 1}}),
        (Flags{true, true, false, true, true, false}));
    const double inf = std::numeric_limits<double>::infinity();
    EXPECT_EQ(pareto_front({{-inf, 2, 1, 1}, {-40, 1, 1, 1}, {-40, 3, 1, 1}}), (Flags{true, true, false}))
        << "a perfect score";
}

TEST(Pareto, BetterHalfTakesWholeFrontsFirst) {
    EXPECT_EQ(better_half({}), Indices{});
    EXPECT_EQ(better_half({{0, 0, 0, 0}}), Indices{0});
    // 1 and 3 dominate 0, which dominates 2.
    EXPECT_EQ(better_half({{-20, 5, 1, 1}, {-22, 5, 1, 1}, {-19, 6, 1, 1}, {-20, 4, 1, 1}}), (Indices{1, 3}));
    EXPECT_EQ(better_half({{-20, 5, 1, 1}, {-22, 5, 1, 1}, {-19, 6, 1, 1}, {-20, 4, 1, 1}, {-18, 7, 1, 1}}),
              (Indices{0, 1, 3}));
}

TEST(Pareto, BetterHalfKeepsTheEndsOfAFrontThatDoesNotFit) {
    // All optimal; 1 and 2 lie close together, 3 far from its neighbours.
    EXPECT_EQ(better_half({{-20, 1, 1, 1}, {-20.1, 1.1, 1, 1}, {-20.2, 1.2, 1, 1}, {-25, 5, 1, 1}, {-30, 10, 1, 1}}),
              (Indices{0, 3, 4}));
    EXPECT_EQ(better_half({{1, 1, 1, 1}, {1, 1, 1, 1}, {1, 1, 1, 1}, {1, 1, 1, 1}}), (Indices{0, 1}))
        << "equal ones: the first";
}

}  // namespace
}  // namespace gs
