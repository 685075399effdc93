// SPDX-License-Identifier: Apache-2.0
// The course of a training on a disk that is full for a while, on one that stays full, and of a run that ends twice.
#include "lib/train/train_log.h"

#include "tests/io/file_helpers.h"
#include "tests/io/limits.h"

namespace gs::test {
namespace {

TEST(TrainLog, LinesOfAFullDiskComeLater) {
    const TempFolder folder;
    const std::filesystem::path path = folder / "stats/train.jsonl";
    const int status = in_child([&] {
        TrainLog log(path, 0, false);
        limit_file_size(30);
        for (int i = 1; i <= 5; ++i) log.write({{"iteration", i}});
        if (slurp(path).size() != 30) return 1;
        limit_file_size(1 << 20);
        log.write({{"iteration", 6}});
        log.close();
        return 0;
    });
    EXPECT_EQ(status, 0);
    std::string expected;
    for (int i = 1; i <= 6; ++i) expected += "{\"iteration\":" + std::to_string(i) + "}\n";
    EXPECT_EQ(slurp(path), expected);
}

TEST(TrainLog, LinesThatAreMissingInTheEndAreADataError) {
    const TempFolder folder;
    const int status = in_child([&] {
        TrainLog log(folder / "train.jsonl", 0, false);
        limit_file_size(30);
        for (int i = 1; i <= 5; ++i) log.write({{"iteration", i}});
        return data_error_status([&] { log.close(); }, "train.jsonl", "File too large");
    });
    EXPECT_EQ(status, 0);
}

TEST(TrainLog, FinalLinesAreWrittenAnewByARunThatOnlyEndsOnceMore) {
    const TempFolder folder;
    const std::filesystem::path path = folder / "train.jsonl";
    const std::string steps = "{\"iteration\":100}\n{\"iteration\":200}\n",
                      end = "{\"final\":true,\"iteration\":200}\n";
    for (const bool at_end : {true, false}) {
        spit(path, steps + end);
        TrainLog(path, 200, at_end).close();
        EXPECT_EQ(slurp(path), at_end ? steps : steps + end);
        spit(path, "{\"final\":true,\"iteration\":100}\n" + steps + end + "{\"iteration\":201}\n");
        TrainLog(path, 200, at_end).close();
        EXPECT_EQ(slurp(path), "{\"final\":true,\"iteration\":100}\n" + steps + (at_end ? "" : end));
    }
}

}  // namespace
}  // namespace gs::test
