// SPDX-License-Identifier: Apache-2.0
// PSNR and SSIM against hand-computed values and a brute-force window; the metrics by name, and what is written of
// them.
#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "eval/metrics/metrics.h"
#include "eval/metrics/pixel_metrics.h"
#include "eval/metrics/quantize.h"
#include "eval/runs/evaluate.h"
#include "eval/runs/results.h"
#include "kernels/base/error.h"
#include "kernels/base/rng.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/fake_engine.h"
#include "tests/eval/support/random_weights.h"

namespace gs {
namespace {

using nlohmann::json;

Image noise(int width, int height, std::uint64_t seed, float scale = 1) {
    Image image{width, height, 3, {}, {}};
    image.f32.resize(std::size_t(width) * height * 3);
    for (std::size_t i = 0; i < image.f32.size(); ++i)
        image.f32[i] = scale * uniform_from_bits(philox(seed, RngStream::kScene, i, 0).v[0]);
    return image;
}

Image constant(int width, int height, float value) {
    Image image{width, height, 3, {}, {}};
    image.f32.assign(std::size_t(width) * height * 3, value);
    return image;
}

/// Computes SSIM by its definition: window by window, two-dimensional, with centred sums.
double brute_force_ssim(const Image& a, const Image& b, SsimBorder border) {
    double total = 0, count = 0;
    const auto sample = [&](const Image& image, int x, int y, int c) -> double {
        if (border == SsimBorder::kReflect) {
            if (x < 0) x = -x;
            if (y < 0) y = -y;
            if (x >= image.width) x = 2 * (image.width - 1) - x;
            if (y >= image.height) y = 2 * (image.height - 1) - y;
        }
        const bool inside = x >= 0 && y >= 0 && x < image.width && y < image.height;
        return inside ? double(image.value(x, y, c)) : 0.0;
    };
    const int margin = border == SsimBorder::kValid ? 5 : 0;
    for (int c = 0; c < 3; ++c) {
        for (int y = margin; y < a.height - margin; ++y) {
            for (int x = margin; x < a.width - margin; ++x) {
                double weights = 0, ma = 0, mb = 0, va = 0, vb = 0, cov = 0;
                const auto weight = [](int dx, int dy) { return std::exp(-(dx * dx + dy * dy) / (2 * 1.5 * 1.5)); };
                for (int dy = -5; dy <= 5; ++dy) {
                    for (int dx = -5; dx <= 5; ++dx) {
                        weights += weight(dx, dy);
                        ma += weight(dx, dy) * sample(a, x + dx, y + dy, c),
                            mb += weight(dx, dy) * sample(b, x + dx, y + dy, c);
                    }
                }
                ma /= weights, mb /= weights;
                for (int dy = -5; dy <= 5; ++dy) {
                    for (int dx = -5; dx <= 5; ++dx) {
                        const double w = weight(dx, dy) / weights, da = sample(a, x + dx, y + dy, c) - ma,
                                     db = sample(b, x + dx, y + dy, c) - mb;
                        va += w * da * da, vb += w * db * db, cov += w * da * db;
                    }
                }
                total += (2 * ma * mb + 1e-4) * (2 * cov + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4));
                count += 1;
            }
        }
    }
    return total / count;
}

TEST(Psnr, HandComputed) {
    EXPECT_NEAR(psnr(constant(3, 2, 0.5f), constant(3, 2, 0.6f)), 20, 1e-5);
    Image one = constant(2, 2, 0.25f);
    one.f32[7] = 0.75f;  // MSE = 0.25 / 12
    EXPECT_NEAR(psnr(constant(2, 2, 0.25f), one), 10 * std::log10(48.0), 1e-9);
    EXPECT_EQ(psnr(one, one), std::numeric_limits<double>::infinity());
    EXPECT_THROW(psnr(constant(2, 2, 0), constant(2, 3, 0)), UsageError);
    EXPECT_THROW(psnr(Image{}, Image{}), UsageError);
}

TEST(Ssim, ConstantImagesHaveTheLuminanceTermOnly) {
    const double expected = (2 * 0.25 * 0.75 + 1e-4) / (0.25 * 0.25 + 0.75 * 0.75 + 1e-4);
    EXPECT_NEAR(ssim(constant(16, 12, 0.25f), constant(16, 12, 0.75f), SsimBorder::kValid), expected, 1e-9);
    EXPECT_NEAR(ssim(constant(16, 12, 0.25f), constant(16, 12, 0.75f), SsimBorder::kReflect), expected, 1e-9);
    EXPECT_GT(std::abs(ssim(constant(16, 12, 0.25f), constant(16, 12, 0.75f), SsimBorder::kZero) - expected), 1e-3)
        << "zeros outside are seen";
}

TEST(Ssim, EqualsTheDefinition) {
    const Image a = noise(17, 13, 1);
    Image b = noise(17, 13, 2, 0.3f);
    for (std::size_t i = 0; i < b.f32.size(); ++i) b.f32[i] = 0.7f * a.f32[i] + b.f32[i];
    for (const SsimBorder border : {SsimBorder::kValid, SsimBorder::kReflect, SsimBorder::kZero}) {
        EXPECT_NEAR(ssim(a, b, border), brute_force_ssim(a, b, border), 1e-9) << int(border);
        EXPECT_NEAR(ssim(a, a, border), 1, 1e-12);
    }
}

TEST(Ssim, SmallImagesFallBackToZeroPadding) {
    const Image a = noise(10, 20, 1), b = noise(10, 20, 2);
    for (const SsimBorder border : {SsimBorder::kValid, SsimBorder::kReflect}) {
        EXPECT_NEAR(ssim(a, b, border), brute_force_ssim(a, b, SsimBorder::kZero), 1e-9);
    }
    EXPECT_NEAR(ssim(noise(11, 11, 1), noise(11, 11, 2), SsimBorder::kValid),
                brute_force_ssim(noise(11, 11, 1), noise(11, 11, 2), SsimBorder::kValid), 1e-9);
}

TEST(Ssim, NamesOfBorders) {
    EXPECT_EQ(parse_ssim_border("zero"), SsimBorder::kZero);
    EXPECT_THROW(parse_ssim_border("mirror"), UsageError);
}

TEST(Quantize, RendersAreClampedRoundedAndInterleaved) {
    RenderedImage render{2, 1, {-0.5f, 0.5f, 0.1f, 1.5f, std::nanf(""), 127.49f / 255}, {1, 1}};
    const Image image = quantized_render(render);
    ASSERT_EQ(image.channels, 3);
    // Planar (3,1,2): red -0.5, 0.5; green 0.1, 1.5; blue NaN, 127.49/255.
    EXPECT_EQ(image.u8, (std::vector<std::uint8_t>{0, 26, 0, 128, 255, 127}));
}

TEST(Quantize, TargetsAreCompositedOnTheBackground) {
    Image rgba{2, 1, 4, {255, 0, 51, 51, 10, 20, 30, 255}, {}};
    // Alpha 0.2 on (0.5, 1, 0): 0.2 + 0.4 = 0.6; 0.8; 0.04.
    EXPECT_EQ(quantized_target(rgba, {0.5f, 1, 0}).u8, (std::vector<std::uint8_t>{153, 204, 10, 10, 20, 30}));
    Image rgb{1, 1, 3, {1, 2, 3}, {}};
    EXPECT_EQ(quantized_target(rgb, {1, 1, 1}).u8, rgb.u8);
    Image hdr{1, 1, 3, {}, {2, 0.5f, -1}};
    EXPECT_EQ(quantized_target(hdr, {0, 0, 0}).u8, (std::vector<std::uint8_t>{255, 128, 0}));
}

// Two image files, and made-up scores as text and JSON.

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

// The metrics by name: what is asked for, what is answered without weights, and what reaches results and tables.

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
    const RunResult result = evaluate_views(backend, views, {0, 0, 0}, options);
    EXPECT_EQ(result.scores.at("LPIPS-VGG").value, 2.0);
    EXPECT_FALSE(result.scores.at("FLIP").value) << "means over different views do not compare";
    EXPECT_EQ(result.scores.at("FLIP").reason, "not measured: view 2");
    write_results(RunFolder{folder.path()}, result);

    const auto read = [&](const char* name) { return parse_json(read_input(folder.path() / name)); };
    const json results = read("results.json"), per_view = read("per_view.json");
    EXPECT_EQ(results["ours_5"].size(), 3u) << results["ours_5"];
    EXPECT_EQ(results["ours_5"]["LPIPS-VGG"], 2.0);
    EXPECT_EQ(results["not_measured"]["ours_5"], (json{{"FLIP", "not measured: view 2"}}));
    EXPECT_EQ(results["protocol"]["ours_5"]["lpips-vgg"], "counts, mean over images");
    EXPECT_EQ(per_view["ours_5"]["LPIPS-VGG"], (json{{"00000.png", 1.0}, {"00001.png", 2.0}, {"00002.png", 3.0}}));
    EXPECT_EQ(per_view["ours_5"]["FLIP"], (json{{"00000.png", 1.0}, {"00002.png", 3.0}}));

    const RunResult stored = read_results(folder.path(), std::nullopt);
    EXPECT_EQ(stored.scores.at("LPIPS-VGG").value, 2.0);
    EXPECT_EQ(stored.scores.at("FLIP").reason, "not measured: view 2");

    options.metrics.clear();
    write_results(RunFolder{folder.path()}, evaluate_views(backend, views, {0, 0, 0}, options));
    EXPECT_FALSE(read("results.json").contains("not_measured")) << "was not asked for this time";
}

}  // namespace
}  // namespace gs
