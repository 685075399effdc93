// SPDX-License-Identifier: Apache-2.0
// The curves of a training, read while its log grows, and how often a training stops for those who watch.
#include "apps/gsapp/live/live_page.h"

#include <gtest/gtest.h>

#include <fstream>
#include <numeric>

#include "apps/gsapp/live/live_training.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

void append(const std::filesystem::path& file, const std::string& text) {
    std::ofstream(file, std::ios::app | std::ios::binary) << text;
}

TEST(CourseLog, GrowsWithItsFile) {
    const test::TemporaryFolder tmp;
    const auto file = tmp.path() / "train.jsonl";
    CourseLog log(file);
    log.update();
    EXPECT_EQ(log.iteration(), 0) << "there is no file yet";
    append(file, R"({"event":"step","iteration":100,"loss":0.5,"num_gaussians":7,"train_seconds":1.5})"
                 "\n"
                 R"({"event":"step","itera)");
    log.update();
    EXPECT_EQ(log.loss().iterations, std::vector<std::int64_t>{100}) << "half a line is none";
    append(file, R"(tion":200,"loss":0.25,"num_gaussians":9,"train_seconds":3})"
                 "\n"
                 R"({"event":"target","iteration":200,"psnr":21.5})"
                 "\n");
    log.update();
    log.update();
    EXPECT_EQ(log.loss().iterations, (std::vector<std::int64_t>{100, 200}));
    EXPECT_EQ(log.loss().values, (std::vector<double>{0.5, 0.25}));
    EXPECT_EQ(log.psnr().values, std::vector<double>{21.5});
    EXPECT_EQ(log.iteration(), 200);
    EXPECT_EQ(log.num_gaussians(), 9);
    EXPECT_EQ(log.train_seconds(), 3);
}

TEST(CourseLog, BeginsAnewWithARunThatReplacesTheOneBefore) {
    const test::TemporaryFolder tmp;
    const auto file = tmp.path() / "train.jsonl";
    CourseLog log(file);
    append(file, "{\"event\":\"step\",\"iteration\":100,\"loss\":0.5}\n{\"event\":\"step\",\"iteration\":200}\n");
    log.update();
    std::ofstream(file, std::ios::trunc) << "{\"event\":\"step\",\"iteration\":100,\"loss\":4}\n";
    log.update();
    EXPECT_EQ(log.loss().values, std::vector<double>{4});
}

TEST(CourseLog, SkipsWhatIsNoLineOfALog) {
    const test::TemporaryFolder tmp;
    const auto file = tmp.path() / "train.jsonl";
    append(file,
           "\n[]\nnull\n{}\n{\"event\":\"step\"}\n{\"event\":\"step\",\"iteration\":\"x\"}\n\xff\xfe\n"
           "{\"event\":7,\"iteration\":1}\n{\"event\":\"step\",\"iteration\":300,\"loss\":null}\n");
    CourseLog log(file);
    log.update();
    EXPECT_EQ(log.loss().iterations, std::vector<std::int64_t>{300});
    EXPECT_TRUE(log.loss().json(10)["values"][0].is_null());
}

TEST(Curve, KeepsItsLastPointWhereItIsThinned) {
    Curve curve;
    for (int k = 1; k <= 1234; ++k) curve.add(k, k);
    for (const std::size_t most : {1u, 7u, 500u, 1234u, 5000u}) {
        const auto json = curve.json(most);
        EXPECT_LE(json["iterations"].size(), most);
        EXPECT_GE(2 * json["iterations"].size(), std::min<std::size_t>(most, 1234));
        EXPECT_EQ(json["iterations"].back(), 1234);
        EXPECT_EQ(json["values"].back(), 1234);
    }
    EXPECT_TRUE(Curve().json(5)["values"].empty());
}

TEST(Pace, TakesAtMostItsShare) {
    Pace pace;
    double now = 10, worked = 0;
    for (const double start = now; now < start + 1000; now += 0.01) {
        if (!pace.due(now)) continue;
        const double cost = 0.2;
        pace.spent(now, cost);
        worked += cost, now += cost;
    }
    EXPECT_LT(worked / 1000, Pace::kMostShare * 1.01);
    EXPECT_GT(worked / 1000, Pace::kMostShare * 0.9) << "and not much less";
    pace.spent(now, 1e-9);
    EXPECT_FALSE(pace.due(now + 1.9));
    EXPECT_TRUE(pace.due(now + 2.1));
}

}  // namespace
}  // namespace gs
