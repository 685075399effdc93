// SPDX-License-Identifier: Apache-2.0
// gsapp metrics as a user runs it.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "lib/io/image.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

TEST(MetricsCommand, ComparesTwoImages) {
    const test::Program program;
    write_image(program.path("a.png"), {40, 40, 3, std::vector<std::uint8_t>(4800, 100), {}});
    write_image(program.path("b.png"), {40, 40, 3, std::vector<std::uint8_t>(4800, 151), {}});
    write_image(program.path("small.png"), {4, 4, 3, std::vector<std::uint8_t>(48, 100), {}});
    const test::Outcome text = program.run("metrics a.png b.png");
    EXPECT_EQ(text.exit_code, 0) << text.err;
    EXPECT_NE(text.out.find("PSNR           13.98  higher is better"), std::string::npos) << text.out;
    EXPECT_NE(text.out.find("LPIPS-VGG  not measured: no weights (see scripts/export_metric_weights.py)"),
              std::string::npos)
        << text.out;
    const test::Outcome numbers = program.run("metrics a.png a.png --metrics psnr,flip,dists --json");
    const auto json = parse_json(numbers.out);
    EXPECT_EQ(json["scores"], (nlohmann::json{{"PSNR", nullptr}, {"FLIP", 0.0}}));
    EXPECT_TRUE(json["not_measured"].contains("DISTS"));
    const test::Outcome sizes = program.run("metrics a.png small.png");
    EXPECT_EQ(sizes.exit_code, 2);
    EXPECT_NE(sizes.err.find("small.png is 4x4"), std::string::npos) << sizes.err;
    EXPECT_EQ(program.run("metrics a.png b.png --metrics lpips").exit_code, 2);
    EXPECT_EQ(program.run("metrics a.png nowhere.png").exit_code, 3);
    program.folder().write("lpips_vgg.safetensors", "x");
    program.folder().write("vgg16.safetensors", "x");
    const test::Outcome damaged = program.run("metrics a.png b.png --metric-weights .");
    EXPECT_EQ(damaged.exit_code, 3);
    EXPECT_NE(damaged.err.find("vgg16.safetensors"), std::string::npos) << damaged.err;
}

}  // namespace
}  // namespace gs
