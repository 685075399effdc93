// SPDX-License-Identifier: Apache-2.0
// The evaluation loop, its pictures, the JSON files and the tables made from them.
#include "eval/runs/evaluate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "eval/report/table.h"
#include "eval/runs/protocol.h"
#include "eval/runs/results.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/fake_engine.h"

namespace gs {
namespace {

using nlohmann::json;
using FakeBackend = test::BackendOf<test::FakeEngine>;
using test::TemporaryFolder;

/// A view of one colour; the fake backend will paint (red, background, 0).
View view(const std::string& name, float red, std::vector<std::uint8_t> pixel, int width = 16, int height = 12) {
    View v;
    v.name = name;
    v.camera.width = width, v.camera.height = height;
    v.camera.translation.x() = red;
    v.load = [pixel, width, height] {
        ViewImage image;
        image.color = {width, height, int(pixel.size()), {}, {}};
        for (int i = 0; i < width * height; ++i)
            image.color.u8.insert(image.color.u8.end(), pixel.begin(), pixel.end());
        return image;
    };
    return v;
}

json read_json(const std::filesystem::path& path) { return parse_json(read_input(path)); }

std::vector<View> two_views() { return {view("a.png", 1.0f, {255, 0, 51}), view("b.png", 0.4f, {0, 0, 0})}; }

TEST(Evaluate, ScoresAreMeansOverViewsOfTheRoundedImages) {
    FakeBackend backend;
    const EvalResult result = evaluate_views(backend, two_views(), {0, 0, 0}, {});
    ASSERT_EQ(result.views.size(), 2u);
    EXPECT_NEAR(result.views[0].psnr, 10 * std::log10(3 / (0.2 * 0.2)), 1e-5);
    EXPECT_NEAR(result.views[1].psnr, 10 * std::log10(3 / (0.4 * 0.4)), 1e-5);
    EXPECT_NEAR(result.psnr, 0.5 * (result.views[0].psnr + result.views[1].psnr), 1e-12);
    EXPECT_NEAR(result.views[1].ssim, (2 + 1e-4 / (0.16 + 1e-4)) / 3, 1e-6);
    EXPECT_EQ(result.views[1].name, "b.png");
    EXPECT_GE(result.render_seconds, 0);
    EXPECT_THROW(evaluate_views(backend, {}, {0, 0, 0}, {}), UsageError);
}

TEST(Evaluate, AlphaIsCompositedOnTheSameBackground) {
    FakeBackend backend;
    // Transparent target on (0, 1, 0) against the fake's (0, 1, 0).
    const EvalResult result = evaluate_views(backend, {view("a", 0, {9, 9, 9, 0})}, {0, 1, 0}, {});
    EXPECT_TRUE(std::isinf(result.psnr));
}

TEST(Evaluate, SizeMismatchIsADataError) {
    FakeBackend backend;
    View v = view("odd.png", 0, {0, 0, 0});
    v.camera.width = 20;
    try {
        evaluate_views(backend, {v}, {0, 0, 0}, {});
        FAIL();
    } catch (const DataError& e) {
        EXPECT_NE(std::string(e.what()).find("odd.png: the image has 16x12 pixels, its camera 20x12"),
                  std::string::npos);
    }
}

TEST(Evaluate, WritesPicturesWhereOtherToolsLookForThem) {
    const TemporaryFolder folder;
    FakeBackend backend;
    EvalOptions options;
    options.run_folder = folder.path();
    options.iteration = 300;
    evaluate_views(backend, two_views(), {0, 0, 0}, options);
    const Image render = read_image(folder.path() / "test/ours_300/renders/00001.png"),
                truth = read_image(folder.path() / "test/ours_300/gt/00000.png");
    EXPECT_EQ(render.u8[0], 102);
    EXPECT_EQ(truth.u8[2], 51);
}

TEST(Evaluate, DecompositionHasTheBaseOnTheBackgroundAndTheResidualOnBlack) {
    const TemporaryFolder folder;
    FakeBackend backend;
    EvalOptions options;
    EXPECT_FALSE(evaluate_views(backend, two_views(), {0, 1, 0}, options).residual_mean);
    options.decompose = true;
    const EvalResult result = evaluate_views(backend, two_views(), {0, 1, 0}, options);
    EXPECT_NEAR(*result.views[0].residual_mean, (1 + 0 + 0.5) / 3, 1e-6);
    EXPECT_NEAR(*result.views[1].residual_mean, (0.4 + 0 + 0.5) / 3, 1e-6);
    EXPECT_NEAR(*result.residual_mean, (0.5 + 0.3) / 2, 1e-6);
    options.run_folder = folder.path();
    options.iteration = 300;
    evaluate_views(backend, two_views(), {0, 1, 0}, options);
    const Image base = read_image(folder.path() / "test/ours_300/base/00001.png"),
                residual = read_image(folder.path() / "test/ours_300/residual/00001.png");
    EXPECT_EQ(std::vector(base.u8.begin(), base.u8.begin() + 3), (std::vector<std::uint8_t>{102, 255, 51}));
    EXPECT_EQ(std::vector(residual.u8.begin(), residual.u8.begin() + 3), (std::vector<std::uint8_t>{102, 0, 128}));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "test/ours_300/renders/00001.png"));
}

TEST(Evaluate, ComparisonShowsPhotographLeftAndRenderRight) {
    const TemporaryFolder folder;
    FakeBackend backend;
    write_comparison(folder.path() / "c.png", backend, two_views(), {0, 0, 0}, 5);
    const Image sheet = read_image(folder.path() / "c.png");
    ASSERT_EQ(sheet.width, 32);
    ASSERT_EQ(sheet.height, 24);
    EXPECT_FLOAT_EQ(sheet.value(3, 3, 2), 0.2f);
    EXPECT_FLOAT_EQ(sheet.value(20, 3, 2), 0);
    EXPECT_FLOAT_EQ(sheet.value(3, 20, 0), 0);
    EXPECT_FLOAT_EQ(sheet.value(20, 20, 0), 0.4f);
    write_comparison(folder.path() / "one.png", backend, two_views(), {0, 0, 0}, 1);
    EXPECT_EQ(read_image(folder.path() / "one.png").height, 12);
}

struct Written {
    TemporaryFolder folder;
    EvalOptions options;
    RunFacts facts;
    EvalResult result;
    Written() {
        options.iteration = 300;
        facts.dataset = "builtin";
        facts.bytes_per_gaussian = 192;
        facts.scene = "builtin:glossy";
        facts.model = "sh (degree 3)";
        facts.strategy = "mcmc";
        facts.num_gaussians = 1234;
        facts.train_seconds = 61.5;
        facts.peak_device_bytes = 1234567890;
        result.views = {{"a.png", 30, 0.9, 0.1}, {"b.png", 32, 0.8, 0.2}};
        result.psnr = 31, result.ssim = 0.85, result.render_seconds = 0.3;
    }
    void write() { write_results(RunFolder{folder.path()}, options, result, facts); }
};

TEST(Results, KeysAreThoseOfTheMetricsScript) {
    Written w;
    w.write();
    const json results = read_json(w.folder.path() / "results.json"),
               per_view = read_json(w.folder.path() / "per_view.json");
    EXPECT_EQ(results.at("ours_300"), (json{{"SSIM", 0.85}, {"PSNR", 31.0}})) << "nothing else may stand inside";
    EXPECT_EQ(per_view.at("ours_300"), (json{{"SSIM", {{"00000.png", 0.9}, {"00001.png", 0.8}}},
                                             {"PSNR", {{"00000.png", 30.0}, {"00001.png", 32.0}}}}));
    EXPECT_EQ(per_view["image_names"]["ours_300"]["00001.png"], "b.png");
    EXPECT_EQ(results["num_gaussians"]["ours_300"], 1234);
    EXPECT_EQ(results["timing"]["ours_300"]["train_seconds"], 61.5);
    EXPECT_EQ(results["memory"]["ours_300"]["peak_device_bytes"], 1234567890);
    EXPECT_NE(results["protocol"]["ours_300"]["ssim"].get<std::string>().find("torchmetrics <= 1.4.1"),
              std::string::npos);
}

TEST(Results, OtherIterationsAndTheTrainingTimeStay) {
    Written w;
    w.write();
    w.options.iteration = 700;
    w.result.psnr = std::numeric_limits<double>::infinity();
    w.write();
    w.options.iteration = 300;
    w.result.psnr = 20;
    w.facts.train_seconds.reset();
    w.facts.peak_device_bytes.reset();
    w.write();
    const json results = read_json(w.folder.path() / "results.json");
    EXPECT_EQ(results["ours_300"]["PSNR"], 20.0);
    EXPECT_EQ(results["timing"]["ours_300"]["train_seconds"], 61.5);
    EXPECT_EQ(results["memory"]["ours_300"]["peak_device_bytes"], 1234567890);
    EXPECT_TRUE(results["ours_700"]["PSNR"].is_null()) << "JSON has no infinity";
    EXPECT_EQ(read_json(w.folder.path() / "per_view.json").count("ours_700"), 1u);
}

TEST(Results, DecompositionStandsBesideTheScores) {
    Written w;
    w.write();
    EXPECT_FALSE(read_json(w.folder.path() / "results.json").contains("decomposition"));
    w.result.residual_mean = 0.25;
    w.result.views[0].residual_mean = 0.2, w.result.views[1].residual_mean = 0.3;
    w.write();
    const json results = read_json(w.folder.path() / "results.json"),
               per_view = read_json(w.folder.path() / "per_view.json");
    EXPECT_EQ(results["ours_300"], (json{{"SSIM", 0.85}, {"PSNR", 31.0}}));
    EXPECT_EQ(results["decomposition"]["ours_300"], (json{{"residual_mean", 0.25}}));
    EXPECT_EQ(per_view["decomposition"]["ours_300"]["residual_mean"], (json{{"00000.png", 0.2}, {"00001.png", 0.3}}));
}

TEST(Results, ABrokenFileIsNamedAndKept) {
    Written w;
    const auto path = w.folder.write("results.json", "{\"ours_1\": ");
    try {
        w.write();
        FAIL();
    } catch (const DataError& e) {
        EXPECT_NE(std::string(e.what()).find("results.json"), std::string::npos);
    }
    std::ifstream file(path);
    std::string text;
    std::getline(file, text);
    EXPECT_EQ(text, "{\"ours_1\": ");
}

TEST(Table, ComesFromStoredFilesAlone) {
    Written w;
    w.write();
    w.options.iteration = 1000;
    w.result.psnr = 33;
    w.write();
    const TableRow last = read_table_row(w.folder.path(), std::nullopt);
    EXPECT_EQ(last.iteration, 1000) << "by number, not by text";
    EXPECT_EQ(last.psnr, 33);
    const TableRow row = read_table_row(w.folder.path().string() + "/", 300);
    EXPECT_EQ(row.psnr, 31);
    EXPECT_EQ(row.run, w.folder.path().filename());
    EXPECT_EQ(row.scene, "builtin:glossy");
    EXPECT_EQ(*row.num_gaussians, 1234);
    EXPECT_EQ(*row.train_seconds, 61.5);
    EXPECT_EQ(*row.peak_device_bytes, 1234567890);
    EXPECT_EQ(row.dataset, "builtin");
    EXPECT_EQ(*row.bytes_per_gaussian, 192);
    EXPECT_EQ(row.protocol_name, "paper");
    EXPECT_EQ(row.protocol, protocol_line(w.options.protocol, {0, 0, 0}));
    EXPECT_THROW(read_table_row(w.folder.path(), 5), DataError);
    EXPECT_THROW(read_table_row(w.folder.path() / "nowhere", std::nullopt), DataError);
}

}  // namespace
}  // namespace gs
