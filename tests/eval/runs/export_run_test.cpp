// SPDX-License-Identifier: Apache-2.0
// Exports of a run with one Gaussian.
#include "apps/gsapp/export/export_run.h"

#include <gtest/gtest.h>

#include "kernels/base/error.h"
#include "tests/eval/support/tiny_run.h"

namespace gs {
namespace {

TEST(ExportRun, WritesFilesForOtherPrograms) {
    const test::TinyRun saved(test::one_sh_gaussian(0.1f));
    const ExportRequest request{
        .run = saved.path(), .iteration = std::nullopt, .output = saved.folder.path() / "out", .overwrite = false};
    export_file(request, SplatFormat::kSplat, false);
    EXPECT_EQ(std::filesystem::file_size(request.output / "point_cloud.splat"), 32u);
    export_file(request, SplatFormat::kPly, false);
    EXPECT_EQ(read_ply(request.output / "point_cloud.ply").count, 1);
    EXPECT_THROW(export_file(request, SplatFormat::kPly, false), UsageError)
        << "an earlier export is not replaced unasked";
    ExportRequest again = request;
    again.overwrite = true;
    EXPECT_NO_THROW(export_file(again, SplatFormat::kPly, true));
}

TEST(ExportRun, WritesAPackedScene) {
    const test::TinyRun saved;
    const ExportRequest request{
        .run = saved.path(), .iteration = 100, .output = saved.folder.path() / "web", .overwrite = false};
    export_web(request);
    EXPECT_GT(std::filesystem::file_size(request.output / "scene.ngsplat"), 16u);
    EXPECT_THROW(export_web(request), UsageError);
    EXPECT_THROW(
        export_web({.run = saved.path(), .iteration = 7, .output = saved.folder.path() / "other", .overwrite = false}),
        DataError);
    EXPECT_FALSE(std::filesystem::exists(saved.folder.path() / "other"));
}

}  // namespace
}  // namespace gs
