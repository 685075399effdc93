// SPDX-License-Identifier: Apache-2.0
// Levels of a run, and what a page is told of them.
#include "lib/export/coarser.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <random>

#include "apps/gsapp/export/export_run.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/export/packed_model.h"
#include "lib/export/site.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/scene.h"
#include "tests/eval/support/tiny_run.h"
#include "tests/kernels/backends.h"

namespace gs {
namespace {

/// Small Gaussians of many colours in the middle of a built-in scene, of model none.
Gaussians cloud(int count) {
    std::mt19937 random(3);
    std::uniform_real_distribution<float> in(-1, 1);
    Gaussians g;
    g.count = count;
    g.appearance = {"none", 0, ColorActivation::kRelu};
    g[Group::kMean].width = g[Group::kScale].width = g[Group::kBase].width = 3;
    g[Group::kRotation].width = 4, g[Group::kOpacity].width = 1;
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k) {
            g[Group::kMean].param.push_back(in(random));
            g[Group::kScale].param.push_back(-4.5f + in(random));
            g[Group::kBase].param.push_back(0.5f * in(random));
        }
        for (const float q : {1.f, in(random), in(random), 0.f}) g[Group::kRotation].param.push_back(q);
        g[Group::kOpacity].param.push_back(2 * in(random));
    }
    return g;
}

nlohmann::json site_json(const std::filesystem::path& file) { return parse_json(read_input(file)); }

/// Returns the mean PSNR of the test views from a file alone: decoded, drawn, rounded to 8 bits and compared here.
double psnr_of_file(const std::filesystem::path& file, const TrainOptions& options) {
    const PackedScene scene = read_ngsplat(file);
    const Scene views = load_scene(options);
    Gaussians model = packed_geometry(scene);
    const auto backend = make_cpu_backend(model.appearance);
    double mean = 0;
    for (const View& view : views.test) {
        set_packed_colors(scene, camera_params<double>(view.camera).position, model);
        backend->upload(model);
        RenderedImage image;
        backend->render({.camera = camera_params(view.camera), .background = options.background.color}, image);
        const Image truth = view.load().color;
        const std::size_t pixels = std::size_t(image.width) * image.height;
        double squared = 0;
        for (std::size_t p = 0; p < pixels; ++p) {
            for (std::size_t c = 0; c < 3; ++c) {
                // In float, as pictures are written: in double a value may round to the other byte.
                const auto byte = [](float x) { return std::floor(std::clamp(x, 0.0f, 1.0f) * 255 + 0.5f); };
                const double alpha = truth.channels == 4 ? truth.u8[4 * p + 3] / 255.0 : 1;
                const float behind[3] = {options.background.color.x, options.background.color.y,
                                         options.background.color.z};
                const double target =
                    alpha * truth.u8[std::size_t(truth.channels) * p + c] / 255 + (1 - alpha) * behind[c];
                const double d = double(byte(image.rgb[c * pixels + p]) - byte(float(target))) / 255;
                squared += d * d;
            }
        }
        mean += -10 * std::log10(squared / double(3 * pixels)) / double(views.test.size());
    }
    return mean;
}

TEST(CoarserLevels, AreHalvesAsLongAsFilesBecomeSmaller) {
    using Counts = std::vector<std::int64_t>;
    EXPECT_EQ(level_counts(0), Counts{});
    EXPECT_EQ(level_counts(1), Counts{});
    EXPECT_EQ(level_counts(4095), Counts{});
    EXPECT_EQ(level_counts(4096), Counts{2048});
    EXPECT_EQ(level_counts(10000), (Counts{5000, 2500}));
    EXPECT_EQ(level_counts(1000001), (Counts{500000, 250000, 125000, 62500}));
}

TEST(CoarserLevels, SiteNamesThemWithThePsnrOfTheirFiles) {
    const test::TinyRun saved(cloud(9000));
    const std::filesystem::path site = saved.folder.path() / "site";
    export_web({.run = saved.path(), .output = site}, {.levels = true});
    const nlohmann::json levels = site_json(site / "site.json").at("levels");
    ASSERT_EQ(levels.size(), 3u);
    double last = 1e9;
    for (std::size_t k = 0; k < levels.size(); ++k) {
        const std::string file = k == 0 ? "scene.ngsplat" : site_file::level(k);
        EXPECT_EQ(levels[k].at("file"), file);
        EXPECT_EQ(levels[k].at("bytes"), std::filesystem::file_size(site / file));
        const PackedScene scene = read_ngsplat(site / file);
        EXPECT_EQ(levels[k].at("num_gaussians"), scene.count());
        EXPECT_LE(scene.count(), 9000 >> k);
        EXPECT_EQ(scene.cameras.size(), read_ngsplat(site / "scene.ngsplat").cameras.size());
        EXPECT_EQ(scene.center, read_ngsplat(site / "scene.ngsplat").center);
        EXPECT_EQ(scene.trailer.find("level_of") != std::string::npos, k > 0);
        const double psnr = levels[k].at("psnr");
        EXPECT_NEAR(psnr, psnr_of_file(site / file, saved.options), 1e-6) << file;
        EXPECT_GT(std::abs(psnr - last), 1e-4) << "the test tells levels apart";
        last = psnr;
    }
    EXPECT_FALSE(std::filesystem::exists(site / site_file::level(3)));

    // A later export without levels leaves none.
    export_web({.run = saved.path(), .output = site, .overwrite = true});
    EXPECT_FALSE(std::filesystem::exists(site / site_file::level(1)));
    EXPECT_FALSE(std::filesystem::exists(site / site_file::level(2)));
    EXPECT_FALSE(std::filesystem::exists(site / "site.json"));
}

TEST(CoarserLevels, OfAFewGaussiansThereAreNone) {
    for (const int count : {0, 1, 4000}) {
        Gaussians model = cloud(std::max(count, 1));
        if (count == 0) model[Group::kOpacity].param[0] = -10;  // never visible: left out
        const test::TinyRun saved(model);
        const std::filesystem::path site = saved.folder.path() / "site";
        export_web({.run = saved.path(), .output = site}, {.levels = true});
        EXPECT_EQ(site_json(site / "site.json").at("levels").size(), 1u) << count;
        EXPECT_FALSE(std::filesystem::exists(site / site_file::level(1))) << count;
        EXPECT_EQ(read_ngsplat(site / "scene.ngsplat").count(), count);
    }
}

TEST(CoarserLevels, WithoutTestViewsTheirPsnrIsNotTold) {
    const test::TinyRun saved(cloud(5000), false);
    const std::filesystem::path site = saved.folder.path() / "site";
    export_web({.run = saved.path(), .output = site}, {.levels = true});
    const nlohmann::json levels = site_json(site / "site.json").at("levels");
    ASSERT_EQ(levels.size(), 2u);
    EXPECT_FALSE(levels[1].contains("psnr"));
    const PackedScene scene = read_ngsplat(site / site_file::level(1));
    EXPECT_NE(scene.trailer.find("\"views\":\"training\""), std::string::npos) << scene.trailer;
    EXPECT_GT(scene.cameras.size(), 0u) << "training views to jump to";
}

// Exports of a run with one Gaussian.

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
