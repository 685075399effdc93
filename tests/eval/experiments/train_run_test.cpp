// SPDX-License-Identifier: Apache-2.0
// Two iterations of a small scene, with and without evaluation.
#include "eval/experiments/train_run.h"

#include <gtest/gtest.h>

#include "lib/core/options.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TrainOptions tiny(const test::TemporaryFolder& tmp) {
    TrainOptions options;
    options.source = "builtin:diffuse";
    options.resolution = 8;
    options.device = Device::kCpu;
    options.appearance = "none";
    options.iterations = 2;
    options.quiet = true;
    options.model = (tmp.path() / "run").string();
    return options;
}

TEST(TrainRun, ScoresWhatWasHeldOut) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options.eval = true;
    validate(options);
    const std::optional<TableRow> row = train_run(options, 1);
    ASSERT_TRUE(row);
    EXPECT_EQ(row->iteration, 2);
    EXPECT_GT(row->psnr, 0);
    EXPECT_TRUE(row->train_seconds);
    EXPECT_TRUE(row->frame_seconds);
    EXPECT_FALSE(row->training.empty()) << "the options are those of the run";
    for (const char* file :
         {"config.yaml", "results.json", "comparison.png", "gsapp.log", "point_cloud/iteration_2/point_cloud.ply"})
        EXPECT_TRUE(std::filesystem::exists(std::filesystem::path(options.model) / file)) << file;
}

TEST(TrainRun, HasNoRowWithoutEvaluation) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    validate(options);
    EXPECT_FALSE(train_run(options, 0));
    EXPECT_FALSE(std::filesystem::exists(std::filesystem::path(options.model) / "results.json"));
}

}  // namespace
}  // namespace gs
