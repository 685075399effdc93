// SPDX-License-Identifier: Apache-2.0
// Repeated runs, protocols, tables and the scores of two images through the program.
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "lib/io/image.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

using test::Outcome;
using test::Program;

constexpr const char* kTiny =
    "train -s builtin:glossy --device cpu --eval -r 8 --iterations 5 --init-points 500 --cap-max 1000 --appearance "
    "nasg ";

TEST(Compare, RepeatedRunsAreOneLineAndAreNotTrainedTwice) {
    const Program program;
    const std::string command = std::string(kTiny) + "-m out --runs 2";
    const Outcome first = program.run(command);
    ASSERT_EQ(first.exit_code, 0) << first.err;
    EXPECT_NE(first.out.find("out-0 .. out-1 (2 runs)"), std::string::npos) << first.out;
    EXPECT_NE(first.out.find("protocol paper: "), std::string::npos) << first.out;
    EXPECT_NE(program.read("out-1/config.yaml").find("seed: 1\n"), std::string::npos);
    const Outcome again = program.run(command);
    ASSERT_EQ(again.exit_code, 0) << again.err;
    EXPECT_NE(again.err.find("run 2 of 2: finished before"), std::string::npos) << again.err;

    const Outcome json = program.run("eval out-1 out-0 --skip-render --format json");
    ASSERT_EQ(json.exit_code, 0) << json.err;
    const auto line = parse_json(json.out)["tables"][0]["lines"][0];
    EXPECT_EQ(line["num_runs"], 2);
    EXPECT_EQ(line["runs"][0]["run"], "out-0");
    EXPECT_GT(line["values"]["PSNR"]["deviation"], 0.0);
    EXPECT_EQ(line["values"]["bytes_per_gaussian"]["mean"], 44.0);
    EXPECT_EQ(line["values"]["ply_bytes_per_gaussian"]["mean"], 100.0);
    EXPECT_EQ(line["values"]["web_bytes_per_gaussian"]["mean"], 48.0);

    EXPECT_EQ(program.run("eval out-0 out-0 --skip-render").exit_code, 2);
    EXPECT_EQ(program.run("train -s builtin:glossy --runs 2 -m x").exit_code, 2) << "nothing is held out";
    EXPECT_FALSE(std::filesystem::exists(program.path("x-0")));
}

TEST(Compare, ProtocolsAreStatedAndNotMixed) {
    const Program program;
    for (const char* run : {"a", "b"}) ASSERT_EQ(program.run(std::string(kTiny) + "-m " + run).exit_code, 0);
    const Outcome inria = program.run("eval a --protocol inria --time-frames 1");
    ASSERT_EQ(inria.exit_code, 0) << inria.err;
    EXPECT_NE(inria.out.find("\nprotocol inria: "), std::string::npos) << inria.out;
    EXPECT_NE(inria.out.find(" FPS |"), std::string::npos) << inria.out;
    EXPECT_EQ(parse_json(program.read("a/results.json"))["protocol"]["ours_5"]["name"], "inria");
    const Outcome mixed = program.run("eval a b --skip-render");
    EXPECT_EQ(mixed.exit_code, 2) << mixed.out;
    EXPECT_NE(mixed.err.find("a: protocol inria: "), std::string::npos) << mixed.err;
    EXPECT_NE(mixed.err.find("b: protocol paper: "), std::string::npos) << mixed.err;
    EXPECT_EQ(program.run("eval a b --protocol gsplat").exit_code, 0);
    const Outcome border = program.run("eval a --ssim-border zero");
    EXPECT_NE(border.out.find("--ssim-border, instead of"), std::string::npos) << border.out;
    EXPECT_EQ(program.run("eval a --protocol brush").exit_code, 2);
    EXPECT_EQ(program.run("eval a --skip-render --protocol inria").exit_code, 2) << "stored scores have their protocol";
}

// gsapp metrics as a user runs it.

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
