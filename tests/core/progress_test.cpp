// SPDX-License-Identifier: Apache-2.0
// Progress lines for programs and for people.
#include "lib/core/progress.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

namespace gs {
namespace {

struct Recorder {
    std::ostringstream bar, lines;
    std::vector<nlohmann::json> parsed() const {
        std::vector<nlohmann::json> result;
        std::istringstream in(lines.str());
        for (std::string line; std::getline(in, line);) result.push_back(parse_json(line));
        return result;
    }
};

TEST(Progress, JsonLinesHoldTheDocumentedFields) {
    Recorder out;
    Progress progress(ProgressStyle::kJsonLines, out.bar, out.lines, 0);
    progress.start(30, 10);
    progress.update(11, 0.5, 100);
    progress.update(20, std::numeric_limits<double>::quiet_NaN(), 200);
    progress.finish();
    const auto lines = out.parsed();
    ASSERT_EQ(lines.size(), 2u);
    EXPECT_EQ(lines[0].size(), 7u);
    EXPECT_EQ(lines[0]["event"], "progress");
    EXPECT_EQ(lines[0]["iteration"], 11);
    EXPECT_EQ(lines[0]["iterations"], 30);
    EXPECT_EQ(lines[0]["loss"], 0.5);
    EXPECT_EQ(lines[0]["num_gaussians"], 100);
    EXPECT_GT(lines[0]["iterations_per_second"], 0);
    EXPECT_GE(lines[0]["eta_seconds"], 0);
    EXPECT_TRUE(lines[1]["loss"].is_null());
    EXPECT_EQ(out.bar.str(), "");
}

TEST(Progress, CountsWhatComesBeforeTheTraining) {
    Recorder out;
    Progress lines(ProgressStyle::kJsonLines, out.bar, out.lines, 0), bar(ProgressStyle::kBar, out.bar, out.lines, 0),
        seldom(ProgressStyle::kJsonLines, out.bar, out.lines, 1000);
    for (Progress* progress : {&lines, &bar, &seldom}) progress->count("images decoded", 7, 300);
    ASSERT_EQ(out.parsed().size(), 1u);
    EXPECT_EQ(out.parsed()[0], parse_json(R"({"event": "count", "what": "images decoded", "done": 7, "total": 300})"));
    EXPECT_NE(out.bar.str().find("images decoded 7/300"), std::string::npos);
}

TEST(Progress, OnlyTheLastLineComesInsideTheInterval) {
    Recorder out;
    Progress progress(ProgressStyle::kJsonLines, out.bar, out.lines, 1000);
    progress.start(3, 0);
    EXPECT_FALSE(progress.due(1));
    EXPECT_TRUE(progress.due(3));
    for (int i = 1; i <= 3; ++i) progress.update(i, 1, 1);
    progress.update(3, 1, 1);
    ASSERT_EQ(out.parsed().size(), 1u);
    EXPECT_EQ(out.parsed()[0]["iteration"], 3);
}

TEST(Progress, BarIsOneLineThatFinishEnds) {
    Recorder out;
    Progress progress(ProgressStyle::kBar, out.bar, out.lines, 0);
    progress.start(10, 0);
    progress.update(1, 0.25, 7);
    progress.update(5, 0.125, 9);
    EXPECT_EQ(out.bar.str().find('\n'), std::string::npos);
    EXPECT_NE(out.bar.str().find("5/10  50%  ETA 0:00  loss 0.1250  9 Gaussians"), std::string::npos) << out.bar.str();
    progress.finish();
    EXPECT_EQ(out.bar.str().back(), '\n');
    progress.event({{"event", "x"}});
    EXPECT_EQ(out.lines.str(), "");
}

TEST(Progress, WhereTimeDecidesTheEtaIsWhatIsLeftOfIt) {
    Recorder out;
    Progress progress(ProgressStyle::kBar | ProgressStyle::kJsonLines, out.bar, out.lines, 0);
    progress.start(0, 0);
    progress.expect_end_in(600);
    progress.update(1000000, 0.25, 7);
    progress.expect_end_in(-1);
    progress.update(1000001, 0.25, 7);
    progress.expect(1000002);
    progress.update(1000002, 0.25, 7);
    EXPECT_NE(out.bar.str().find("K1000000 iterations  ETA 10:00  loss"), std::string::npos) << out.bar.str();
    EXPECT_NE(out.bar.str().find("1000002/1000002 100%  ETA 0:00"), std::string::npos) << out.bar.str();
    const auto lines = out.parsed();
    ASSERT_EQ(lines.size(), 3u);
    EXPECT_TRUE(lines[0]["iterations"].is_null());
    EXPECT_NEAR(double(lines[0]["eta_seconds"]), 600, 5);
    EXPECT_EQ(lines[1]["eta_seconds"], 0);
    EXPECT_EQ(lines[2]["iterations"], 1000002);
}

TEST(Progress, AnEtaThatIsNotKnownIsNoNumber) {
    Recorder out;
    Progress progress(ProgressStyle::kBar | ProgressStyle::kJsonLines, out.bar, out.lines, 0);
    progress.start(0, 0);
    progress.update(1, 0.25, 7);
    EXPECT_NE(out.bar.str().find("1 iterations  ETA -"), std::string::npos) << out.bar.str();
    EXPECT_TRUE(out.parsed().at(0)["eta_seconds"].is_null());
}

TEST(Progress, TheBarNeverWraps) {
    for (const int columns : {20, 40, 60, 80, 120}) {
        Recorder out;
        Progress progress(ProgressStyle::kBar, out.bar, out.lines, 0, columns);
        progress.start(30000, 0, "controller");
        progress.update(29999, 0.25, 100000000);
        progress.count("images decoded", 123456, 234567);
        std::istringstream lines(out.bar.str());
        std::size_t longest = 0;
        for (std::string line; std::getline(lines, line, '\r');)
            longest = std::max(longest, line.size() - (line.starts_with("\033[K") ? 3 : 0));
        EXPECT_LT(longest, std::size_t(columns)) << out.bar.str();
        EXPECT_GT(longest, 10u);
    }
}

TEST(Progress, LinesThatDoNotFitLoseTheirLastParts) {
    EXPECT_EQ(fitting_line({"12/30", "ETA 1", "loss 2"}, 20), "12/30  ETA 1  loss 2");
    EXPECT_EQ(fitting_line({"12/30", "ETA 1", "loss 2"}, 19), "12/30  ETA 1");
    EXPECT_EQ(fitting_line({"12/30", "ETA 1"}, 3), "12/");
}

TEST(Progress, BarAndLinesGoTogether) {
    Recorder out;
    Progress progress(ProgressStyle::kBar | ProgressStyle::kJsonLines, out.bar, out.lines, 0);
    progress.start(10, 0);
    progress.update(5, 0.125, 9);
    progress.count("images decoded", 7, 300);
    progress.finish();
    EXPECT_NE(out.bar.str().find("5/10"), std::string::npos);
    EXPECT_NE(out.bar.str().find("images decoded 7/300"), std::string::npos);
    ASSERT_EQ(out.parsed().size(), 2u);
    EXPECT_EQ(out.parsed()[0]["iteration"], 5);
    EXPECT_EQ(out.parsed()[1]["event"], "count");
}

/// Returns the messages that `show` leaves on stderr.
template <class Fn> std::string messages(Fn&& show) {
    testing::internal::CaptureStderr();
    setup_log(LogLevel::kInfo);
    show();
    return testing::internal::GetCapturedStderr();
}

TEST(Progress, PlainLinesAreOneForEachTenth) {
    Recorder out;
    const std::string text = messages([&] {
        Progress progress(ProgressStyle::kPlainLines, out.bar, out.lines, 0);
        progress.start(200, 50);
        for (int i = 51; i <= 200; ++i) progress.update(i, 0.25, i);
    });
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 7) << "60/200 to 180/200\n" << text;
    EXPECT_TRUE(text.starts_with("info: 60/200  30%  ETA 0:00  loss 0.2500  60 Gaussians")) << text;
    EXPECT_EQ(text.find("200/200"), std::string::npos) << text;
    EXPECT_EQ(out.bar.str() + out.lines.str(), "");
}

TEST(Progress, PlainLinesFollowTheClockWhereTimeDecides) {
    Recorder out;
    const std::string text = messages([&] {
        Progress progress(ProgressStyle::kPlainLines, out.bar, out.lines, 0);
        progress.start(0, 0);
        progress.expect_end_in(600);
        progress.update(1000, 0.25, 7);
        progress.expect_end_in(0);
        progress.update(2000, 0.25, 7);
        progress.update(2001, 0.25, 7);
    });
    EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;
    EXPECT_TRUE(text.starts_with("info: 2000 iterations")) << text;
}

TEST(Progress, PlainLinesAreRare) {
    Recorder out;
    EXPECT_EQ(messages([&] {
                  Progress progress(ProgressStyle::kPlainLines, out.bar, out.lines, 5);
                  progress.start(10, 0);
                  for (int i = 1; i <= 10; ++i) progress.update(i, 0.25, i);
              }),
              "");
}

TEST(Progress, StdoutIsForProgramsThatAskForJson) {
    EXPECT_FALSE(has(progress_style(false, false), ProgressStyle::kJsonLines));
    EXPECT_TRUE(has(progress_style(false, true), ProgressStyle::kJsonLines));
    EXPECT_EQ(progress_style(true, true), ProgressStyle::kJsonLines);
    EXPECT_EQ(progress_style(true, false), ProgressStyle::kSilent);
}

TEST(Progress, SilentShowsNothing) {
    Recorder out;
    Progress progress(ProgressStyle::kSilent, out.bar, out.lines, 0);
    progress.start(1, 0);
    EXPECT_FALSE(progress.due(1));
    progress.update(1, 1, 1);
    progress.event({{"event", "x"}});
    progress.finish();
    EXPECT_EQ(out.bar.str() + out.lines.str(), "");
}

TEST(Progress, EventsAreSingleLines) {
    Recorder out;
    Progress progress(ProgressStyle::kJsonLines, out.bar, out.lines, 0);
    progress.event({{"event", "evaluation"}, {"note", "two\nlines"}});
    ASSERT_EQ(out.parsed().size(), 1u);
    EXPECT_EQ(out.parsed()[0]["note"], "two\nlines");
}

}  // namespace
}  // namespace gs
