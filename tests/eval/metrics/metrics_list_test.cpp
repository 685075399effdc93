// SPDX-License-Identifier: Apache-2.0
// The metrics by name: what is asked for, what is answered without weights, and what reaches results and tables.
#include "eval/metrics/metrics.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "eval/report/table.h"
#include "eval/runs/results.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/fake_engine.h"
#include "tests/eval/support/random_weights.h"

namespace gs {
namespace {

using nlohmann::json;

TEST(Metrics, NamesAreCheckedAndOrdered) {
    EXPECT_EQ(parse_metric_names("flip,psnr,flip"), (std::vector<std::string>{"psnr", "flip"}));
    EXPECT_EQ(parse_metric_names("all").size(), known_metrics().size());
    for (const char* bad : {"", "psnr,", "lpips", "PSNR"}) EXPECT_THROW(parse_metric_names(bad), UsageError) << bad;
    EXPECT_THROW(make_metrics({"vmaf"}, {}), UsageError);
    EXPECT_THROW(parse_lpips_range("0..1"), UsageError);
    EXPECT_THROW(metric_weights_folder("/nowhere"), UsageError);
}

TEST(Metrics, WithoutWeightsThereIsAReasonAndNoNumber) {
    const Image image = test::noise_image(40, 40, 1);
    const test::TemporaryFolder empty;
    for (const MetricInfo& info : known_metrics()) {
        const bool learned = info.name != "psnr" && info.name != "ssim" && info.name != "flip";
        const MetricScore score = make_metrics({info.name}, {})[0].compute(image, image);
        EXPECT_EQ(score.value.has_value(), !learned) << info.name;
        EXPECT_EQ(score.reason, learned ? "not measured: no weights (see scripts/export_metric_weights.py)" : "")
            << info.name;
        if (!learned) continue;
        MetricOptions options;
        options.weights = empty.path();
        const MetricScore missing = make_metrics({info.name}, options)[0].compute(image, image);
        EXPECT_FALSE(missing.value) << info.name;
        EXPECT_NE(missing.reason.find(".safetensors is missing"), std::string::npos) << missing.reason;
    }
}

/// A metric that answers 1, 2, ... for one view after the other, and nothing for views of number `unmeasured`.
Metric counting(const MetricInfo& info, int unmeasured) {
    return {info, "counts", [unmeasured, n = 0](const Image&, const Image&) mutable {
                return ++n == unmeasured ? MetricScore{std::nullopt, "not measured: view " + std::to_string(n)}
                                         : MetricScore{double(n), ""};
            }};
}

View view(const std::string& name) {
    View v;
    v.name = name;
    v.camera.width = 4, v.camera.height = 3;
    v.load = [] {
        ViewImage image;
        image.color = {4, 3, 3, std::vector<std::uint8_t>(36, 7), {}};
        return image;
    };
    return v;
}

TEST(Metrics, ReachResultsAndTables) {
    const test::TemporaryFolder folder;
    test::BackendOf<test::FakeEngine> backend;
    EvalOptions options;
    options.run_folder = folder.path();
    options.iteration = 5;
    options.metrics = {counting(known_metrics()[2], 0), counting(known_metrics()[4], 2)};  // LPIPS-VGG, FLIP
    const std::vector<View> views = {view("a"), view("b"), view("c")};
    const EvalResult result = evaluate_views(backend, views, {0, 0, 0}, options);
    EXPECT_EQ(result.scores.at("LPIPS-VGG").value, 2.0);
    EXPECT_FALSE(result.scores.at("FLIP").value) << "means over different views do not compare";
    EXPECT_EQ(result.scores.at("FLIP").reason, "not measured: view 2");
    write_results(RunFolder{folder.path()}, options, result, {});

    const auto read = [&](const char* name) { return parse_json(read_input(folder.path() / name)); };
    const json results = read("results.json"), per_view = read("per_view.json");
    EXPECT_EQ(results["ours_5"].size(), 3u) << results["ours_5"];
    EXPECT_EQ(results["ours_5"]["LPIPS-VGG"], 2.0);
    EXPECT_EQ(results["not_measured"]["ours_5"], (json{{"FLIP", "not measured: view 2"}}));
    EXPECT_EQ(results["protocol"]["ours_5"]["lpips-vgg"], "counts, mean over images");
    EXPECT_EQ(per_view["ours_5"]["LPIPS-VGG"], (json{{"00000.png", 1.0}, {"00001.png", 2.0}, {"00002.png", 3.0}}));
    EXPECT_EQ(per_view["ours_5"]["FLIP"], (json{{"00000.png", 1.0}, {"00002.png", 3.0}}));

    const TableRow row = read_table_row(folder.path(), std::nullopt);
    EXPECT_EQ(row.further_metrics.at("LPIPS-VGG"), 2.0);
    EXPECT_EQ(row.not_measured.at("FLIP"), "not measured: view 2");

    options.metrics.clear();
    write_results(RunFolder{folder.path()}, options, evaluate_views(backend, views, {0, 0, 0}, options), {});
    EXPECT_FALSE(read("results.json").contains("not_measured")) << "was not asked for this time";
}

}  // namespace
}  // namespace gs
