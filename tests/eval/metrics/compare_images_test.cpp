// SPDX-License-Identifier: Apache-2.0
// Two image files, and made-up scores as text and JSON.
#include "eval/metrics/metrics.h"

#include <gtest/gtest.h>

#include <limits>

#include "kernels/base/error.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TEST(CompareImages, ScoresTwoFiles) {
    const test::TemporaryFolder tmp;
    const auto write = [&](const char* name, int size, std::uint8_t value) {
        write_image(tmp.path() / name,
                    {size, size, 3, std::vector<std::uint8_t>(std::size_t(size * size * 3), value), {}});
        return tmp.path() / name;
    };
    const auto a = write("a.png", 40, 100), b = write("b.png", 40, 151), small = write("small.png", 4, 100);
    const std::vector<ImageScore> scores = compare_images(a, b, {"psnr", "ssim"}, {});
    ASSERT_EQ(scores.size(), 2u);
    EXPECT_EQ(scores[0].metric.key, "PSNR");
    EXPECT_NEAR(*scores[0].score.value, 13.979, 1e-3) << "the images differ by a fifth of the range";
    EXPECT_THROW(compare_images(a, small, {"psnr"}, {}), UsageError);
    EXPECT_THROW(compare_images(a, tmp.path() / "nowhere.png", {"psnr"}, {}), DataError);
}

TEST(CompareImages, SaysWhyAScoreIsMissing) {
    ImageScore infinite, missing;
    infinite.metric.key = "PSNR", infinite.metric.name = "psnr", infinite.metric.decimals = 2,
    infinite.metric.higher_is_better = true;
    infinite.protocol = "made up", infinite.score.value = std::numeric_limits<double>::infinity();
    missing.metric.key = "DISTS", missing.metric.name = "dists", missing.protocol = "made up",
    missing.score.reason = "no weights";
    EXPECT_EQ(format_scores({infinite, missing}),
              "PSNR             inf  higher is better; made up\nDISTS      no weights\n");
    const auto json = scores_json({infinite, missing});
    EXPECT_TRUE(json["scores"]["PSNR"].is_null());
    EXPECT_EQ(json["not_measured"]["DISTS"], "no weights");
    EXPECT_EQ(json["protocol"]["dists"], "made up");
}

}  // namespace
}  // namespace gs
