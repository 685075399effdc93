// SPDX-License-Identifier: Apache-2.0
// .splat files, projections to spherical harmonics, and the output folder.
#include <cmath>
#include <cstring>

#include "kernels/base/error.h"
#include "lib/export/sh_projection.h"
#include "lib/export/site.h"
#include "lib/export/splat_file.h"
#include "tests/io/file_helpers.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

namespace fs = std::filesystem;

TEST(SplatFile, Has32BytesAGaussianLargestFirst) {
    const TempFolder folder;
    Gaussians g = random_gaussians(100, {"none", 0, ColorActivation::kRelu});
    std::fill_n(g[Group::kScale].param.begin() + 3 * 42, 3, 5.0f);
    write_splat(folder / "p.splat", g, {});
    const std::string bytes = slurp(folder / "p.splat");
    ASSERT_EQ(bytes.size(), 3200u);
    float numbers[6];
    std::memcpy(numbers, bytes.data(), sizeof numbers);
    for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(numbers[k], g[Group::kMean].param[std::size_t(3 * 42 + k)]);
        EXPECT_FLOAT_EQ(numbers[3 + k], std::exp(5.0f));
        const double color = std::clamp(255 * (g[Group::kBase].param[std::size_t(3 * 42 + k)] + 0.5), 0.0, 255.0);
        EXPECT_NEAR(std::uint8_t(bytes[std::size_t(24 + k)]), color, 0.51);
    }
    EXPECT_NEAR(std::uint8_t(bytes[27]), 255 * sigmoid(double(g[Group::kOpacity].param[42])), 0.51);
    const float* q = g[Group::kRotation].param.data() + 4 * 42;
    const double norm =
        std::sqrt(double(q[0]) * q[0] + double(q[1]) * q[1] + double(q[2]) * q[2] + double(q[3]) * q[3]);
    for (int k = 0; k < 4; ++k)
        EXPECT_NEAR((std::uint8_t(bytes[std::size_t(28 + k)]) - 128) / 128.0, q[k] / norm, 1.0 / 64);
    g.count = 0;
    write_splat(folder / "none.splat", random_gaussians(0, {"none", 0, ColorActivation::kRelu}), {});
    EXPECT_EQ(fs::file_size(folder / "none.splat"), 0u);
}

TEST(ShProjection, FindsWhatIsThere) {
    // Where no colour is cut off at 0, spherical harmonics are their own projection.
    Gaussians g = random_gaussians(20, {"sh", 3, ColorActivation::kRelu});
    for (float& x : g[Group::kResidual].param) x *= 0.02f;
    for (float& x : g[Group::kBase].param) x = std::abs(x);
    const ShProjection same = project_to_sh(g, 3);
    EXPECT_GT(same.psnr, 120);
    for (std::size_t k = 0; k < g[Group::kResidual].param.size(); ++k)
        EXPECT_NEAR(same.gaussians[Group::kResidual].param[k], g[Group::kResidual].param[k], 1e-6);
    for (std::size_t k = 0; k < g[Group::kBase].param.size(); ++k)
        EXPECT_NEAR(same.gaussians[Group::kBase].param[k], g[Group::kBase].param[k], 1e-6);
    EXPECT_EQ(same.gaussians[Group::kMean].param, g[Group::kMean].param);
    const ShProjection mean = project_to_sh(g, 0);
    EXPECT_LT(mean.psnr, 60);
    EXPECT_EQ(mean.gaussians.appearance.model, "none");
    for (std::size_t k = 0; k < g[Group::kBase].param.size(); ++k)
        EXPECT_NEAR(mean.gaussians[Group::kBase].param[k], g[Group::kBase].param[k], 1e-3);
}

TEST(ShProjection, FitsEveryModelBetterWithMoreBands) {
    for (const ModelInfo* model : appearance_models()) {
        if (model->name == "none") continue;
        SCOPED_TRACE(model->name);
        Gaussians g = random_gaussians(20, {model->name, model->default_max_degree, ColorActivation::kSoftplus});
        const double psnr[3] = {project_to_sh(g, 0).psnr, project_to_sh(g, 1).psnr, project_to_sh(g, 3).psnr};
        EXPECT_LT(psnr[0], psnr[1]);
        EXPECT_LT(psnr[1], psnr[2]);
        EXPECT_TRUE(std::isfinite(psnr[2]));
    }
}

TEST(Staging, AppearsAtOnceOrNotAtAll) {
    const TempFolder folder;
    {
        const Staging abandoned(folder / "site");
        spit(abandoned.path() / "a", "new");
    }
    EXPECT_EQ(folder.num_entries(), 0u);
    spit(folder / "site/kept", "old");
    spit(folder / "site/a", "old");
    {
        Staging staging(folder / "site/");
        spit(staging.path() / "a", "new");
        spit(staging.path() / "sub/b c", "new");
        EXPECT_EQ(slurp(folder / "site/a"), "old");
        staging.publish();
    }
    EXPECT_EQ(folder.num_entries(), 1u);
    EXPECT_EQ(slurp(folder / "site/a"), "new");
    EXPECT_EQ(slurp(folder / "site/sub/b c"), "new");
    EXPECT_EQ(slurp(folder / "site/kept"), "old");
}

TEST(Staging, ThePageComesAfterAllItRefersTo) {
    const TempFolder folder;
    spit(folder / "site/index.html", "old");
    const std::vector<std::string> names = {"a.json", "m.ngsplat", "z.js"};
    for (const std::string& name : names) spit(folder / "site" / name / "blocks", "a folder where a file is to be");
    Staging staging(folder / "site");
    for (const std::string& name : names) spit(staging.path() / name, "new");
    spit(staging.path() / "index.html", "new");
    EXPECT_CONTAINS(message_of<DataError>([&] { staging.publish(); }), "cannot write");
    EXPECT_EQ(slurp(folder / "site/index.html"), "old");
}

TEST(Staging, EarlierFilesAreProtected) {
    const TempFolder folder;
    spit(folder / "site/a", "old");
    require_free(folder / "site", {"b"}, false);
    require_free(folder / "site", {"a"}, true);
    require_free(folder / "other", {"a"}, false);
    EXPECT_CONTAINS(message_of<UsageError>([&] { require_free(folder / "site", {"b", "a"}, false); }), "--overwrite");
    EXPECT_CONTAINS(message_of<UsageError>([&] { require_free(folder / "site/a", {}, true); }), "is a file");
}

TEST(Site, KeepsNothingOfAnEarlierOneButWhatIsNotItsOwn) {
    const TempFolder folder;
    const std::vector<std::string> left = {"scene.ngsplat", "scene-2.ngsplat", "site.json", "photographs/00000.png",
                                           "photographs/00001.png"},
                                   foreign = {"notes.txt", "photographs/mine.png", "photographs/old/00001.png"};
    for (const auto* names : {&left, &foreign})
        for (const std::string& name : *names) spit(folder / "site" / name, "earlier");
    remove_earlier_site(folder / "site", {"scene.ngsplat", "site.json", "photographs/00001.png"});
    EXPECT_EQ(site_file::photograph(1), "photographs/00001.png");
    for (const std::string name : {"scene.ngsplat", "site.json", "photographs/00001.png"})
        EXPECT_TRUE(fs::exists(folder / "site" / name)) << name;
    for (const std::string& name : foreign) EXPECT_TRUE(fs::exists(folder / "site" / name)) << name;
    for (const std::string name : {"scene-2.ngsplat", "photographs/00000.png"})
        EXPECT_FALSE(fs::exists(folder / "site" / name)) << name;
    fs::remove_all(folder / "site/photographs/old");
    fs::remove(folder / "site/photographs/mine.png");
    remove_earlier_site(folder / "site", {"scene.ngsplat"});
    EXPECT_FALSE(fs::exists(folder / "site/site.json"));
    EXPECT_FALSE(fs::exists(folder / "site/photographs"));
    remove_earlier_site(folder / "site", {});
    EXPECT_TRUE(fs::exists(folder / "site/scene.ngsplat")) << "an export without a scene does not exist";
}

TEST(Staging, CopiesFilesButNoLinks) {
    const TempFolder folder;
    spit(folder / "from/index.html", "page");
    spit(folder / "from/assets/a.js", "script");
    fs::create_symlink("/etc/passwd", folder / "from/link");
    copy_folder(folder / "from", folder / "to");
    EXPECT_EQ(slurp(folder / "to/assets/a.js"), "script");
    EXPECT_FALSE(fs::exists(folder / "to/link"));
    EXPECT_CONTAINS(message_of<DataError>([&] { copy_folder(folder / "nowhere", folder / "to"); }), "nowhere");
}

TEST(Site, OtherVersionsOfTheViewersFilesGo) {
    const TempFolder folder;
    for (const char* file : {"index.html", "assets/index-NewNewNe.js", "assets/worker-Same0000.js"})
        spit(folder / "viewer" / file, "new");
    const std::vector<std::string> kept = {"index.html",
                                           "assets/index-NewNewNe.js",
                                           "assets/worker-Same0000.js",
                                           "assets/index-notes.js",
                                           "assets/index-notebook.js",
                                           "assets/index-OldOld_1.css",
                                           "assets/mine-OldOld_1.js",
                                           "index-OldOld_1.js",
                                           "scene.ngsplat",
                                           "my-own/index-OldOld_1.js"};
    const std::vector<std::string> gone = {"assets/index-OldOld_1.js", "assets/index-Ol-dOld2.js",
                                           "assets/worker-Old12345.js"};
    for (const std::string& file : kept) spit(folder / "site" / file, "old");
    for (const std::string& file : gone) spit(folder / "site" / file, "old");
    fs::create_symlink("index-notes.js", folder / "site/assets/index-Linked00.js");
    remove_other_versions(folder / "viewer", folder / "site");
    EXPECT_TRUE(fs::is_symlink(folder / "site/assets/index-Linked00.js"));
    for (const std::string& file : kept) EXPECT_TRUE(fs::exists(folder / "site" / file)) << file;
    for (const std::string& file : gone) EXPECT_FALSE(fs::exists(folder / "site" / file)) << file;
}

}  // namespace
}  // namespace gs::test
