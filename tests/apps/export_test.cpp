// SPDX-License-Identifier: Apache-2.0
// gsapp export and view on a run of the program.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "lib/export/ngsplat.h"
#include "lib/export/site.h"
#include "lib/io/image.h"
#include "lib/model/ply.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using test::Outcome;
using test::Program;
using namespace std::string_literals;

/// A run of `sv`, which depends on the view from the first iteration on.
void train(const Program& program, const std::string& more = "") {
    program.train("run", "-s builtin:glossy --eval --appearance sv --iterations 30 --init-points 500 -r 8 " + more);
}

TEST(Export, WritesPackedSceneWithWhatItLost) {
    const Program program;
    train(program, "--ppisp on --controller-iterations 5");
    const Outcome outcome = program.run("export run -o 'my site'");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_NE(outcome.err.find("128 bytes each"), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("dB lost"), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find("device: "), outcome.err.rfind("device: ")) << "said once: " << outcome.err;
    EXPECT_EQ(fs::exists(program.path("my site/index.html")), !viewer_folder().empty());
    const PackedScene scene = read_ngsplat(program.path("my site/scene.ngsplat"));
    EXPECT_GT(scene.count(), 0);
    EXPECT_GT(scene.cameras.size(), 0u);
    ASSERT_TRUE(scene.ppisp);
    EXPECT_EQ(scene.ppisp->views.size(), scene.cameras.size());
    for (const char* key :
         {"\"appearance\":\"sv\"", "\"background\":[", "\"packed_psnr\":", "\"photometric\":\"controller\""})
        EXPECT_NE(scene.trailer.find(key), std::string::npos) << key << " in " << scene.trailer;

    const Outcome told = program.run("export run -o told --json --quiet");
    ASSERT_EQ(told.exit_code, 0) << told.err;
    EXPECT_EQ(told.err, "");
    const nlohmann::json model = parse_json(told.out).at("models").at(0);
    EXPECT_EQ(model["file"], "told/scene.ngsplat");
    EXPECT_EQ(model["bytes"], fs::file_size(program.path("told/scene.ngsplat")));
    EXPECT_EQ(model["num_gaussians"], scene.count());
    const nlohmann::json measured = parse_json(scene.trailer).at("test_views");
    EXPECT_EQ(model["psnr"], measured["psnr"]);
    EXPECT_EQ(model["packed_psnr"], measured["packed_psnr"]);
    const Outcome ply = program.run("export run -o told --format ply --json --quiet");
    ASSERT_EQ(ply.exit_code, 0) << ply.err;
    EXPECT_TRUE(parse_json(ply.out)["models"][0]["psnr"].is_null()) << ply.out;

    const Outcome again = program.run("export run -o 'my site'");
    EXPECT_EQ(again.exit_code, 2);
    EXPECT_NE(again.err.find("--overwrite"), std::string::npos);
    EXPECT_EQ(program.run("export run -o 'my site' --overwrite").exit_code, 0);
    for (const auto& entry : fs::directory_iterator(program.folder().path()))
        EXPECT_NE(entry.path().extension(), ".tmp") << entry.path();
}

/// A run without view dependence; `more` has the scene and its size.
void train_plain(const Program& program, const std::string& run, const std::string& more) {
    program.train(run, "--appearance none --iterations 5 --init-points 300 " + more);
}

TEST(Export, WritesTwoRunsAndTheirPhotographs) {
    const Program program;
    train(program);
    train_plain(program, "plain", "-s builtin:glossy --eval -r 8");
    const Outcome both = program.run("export run plain/ --photographs -o site");
    ASSERT_EQ(both.exit_code, 0) << both.err;
    const PackedScene first = read_ngsplat(program.path("site/scene.ngsplat")),
                      second = read_ngsplat(program.path("site/scene-2.ngsplat"));
    EXPECT_NE(first.trailer.find("\"appearance\":\"sv\""), std::string::npos) << first.trailer;
    EXPECT_NE(first.trailer.find("\"site\":true"), std::string::npos) << first.trailer;
    EXPECT_NE(second.trailer.find("\"appearance\":\"none\""), std::string::npos) << second.trailer;
    const nlohmann::json site = parse_json(program.read("site/site.json"));
    EXPECT_EQ(site.at("version"), 1);
    EXPECT_EQ(site.at("models").at(0).at("file"), "scene.ngsplat");
    EXPECT_EQ(site.at("models").at(0).at("name"), "run");
    EXPECT_EQ(site.at("models").at(1).at("file"), "scene-2.ngsplat");
    EXPECT_EQ(site.at("models").at(1).at("name"), "plain");
    ASSERT_EQ(site.at("photographs").size(), first.cameras.size());
    // They are the pictures that the scores were computed from.
    for (std::size_t i = 0; i < first.cameras.size(); ++i) {
        const std::string photograph = program.read("site/" + site.at("photographs").at(i).get<std::string>());
        EXPECT_FALSE(photograph.empty());
        EXPECT_EQ(photograph, program.read(fmt::format("run/test/ours_30/gt/{:05}.png", i))) << i;
    }
    EXPECT_EQ(program.run("export run plain -o site").exit_code, 2) << "an earlier export is not replaced unasked";

    // A later export leaves nothing of the earlier one that the page would show with it.
    const Outcome few = program.run("export run --photographs=2 -o site --overwrite");
    ASSERT_EQ(few.exit_code, 0) << few.err;
    const nlohmann::json paths = parse_json(program.read("site/site.json")).at("photographs");
    EXPECT_EQ(paths.size(), first.cameras.size());
    EXPECT_EQ(std::count(paths.begin(), paths.end(), nullptr), std::ptrdiff_t(paths.size()) - 2);
    const auto photographs = fs::directory_iterator(program.path("site/photographs"));
    EXPECT_EQ(std::distance(begin(photographs), end(photographs)), 2);
    EXPECT_FALSE(fs::exists(program.path("site/scene-2.ngsplat")));
    ASSERT_EQ(program.run("export run -o site --overwrite").exit_code, 0);
    EXPECT_FALSE(fs::exists(program.path("site/site.json")));
    EXPECT_FALSE(fs::exists(program.path("site/photographs")));
    EXPECT_EQ(read_ngsplat(program.path("site/scene.ngsplat")).trailer.find("\"site\""), std::string::npos);
}

TEST(Export, RunsThatDoNotCompareAreRefused) {
    const Program program;
    train_plain(program, "run", "-s builtin:glossy --eval -r 8");
    train_plain(program, "larger", "-s builtin:glossy --eval -r 4");
    train_plain(program, "all", "-s builtin:glossy -r 8");
    const auto refused = [&](const std::string& arguments, const std::string& word) {
        const Outcome outcome = program.run("export -o out " + arguments);
        EXPECT_EQ(outcome.exit_code, 2) << arguments << "\n" << outcome.err;
        EXPECT_NE(outcome.err.find(word), std::string::npos) << arguments << "\n" << outcome.err;
        EXPECT_FALSE(fs::exists(program.path("out"))) << arguments;
    };
    refused("run larger", "do not compare: their test view 1 has other cameras");
    refused("run all", "do not compare: ");
    refused("all --photographs", "no test views");
    refused("run --photographs --format ply", "--photographs is for --format web");
    refused("run larger --format splat", "two runs are for --format web");
    refused("run --photographs=-3", "-3");
    refused("run --lod --format ply", "--lod is for --format web");
    EXPECT_EQ(program.run("export all all -o out").exit_code, 0) << "training views compare as well";
}

TEST(Export, LevelsOfAPointCloudNeedItsScene) {
    const Program program;
    train_plain(program, "run", "-s builtin:glossy -r 8");
    ASSERT_EQ(program.run("export run -o out --format ply").exit_code, 0);
    const Outcome without = program.run("export out/point_cloud.ply --lod -o site --device cpu");
    EXPECT_EQ(without.exit_code, 2) << without.err;
    EXPECT_NE(without.err.find("--source"), std::string::npos) << without.err;
    EXPECT_FALSE(fs::exists(program.path("site")));
    const Outcome with = program.run("export out/point_cloud.ply --lod -o site --device cpu -s builtin:glossy -r 8");
    EXPECT_EQ(with.exit_code, 0) << with.err;
    EXPECT_NE(with.err.find("scene-level-1.ngsplat: "), std::string::npos) << with.err;
    EXPECT_TRUE(fs::exists(program.path("site/scene-level-1.ngsplat")));
}

TEST(Export, WritesFilesForOtherPrograms) {
    const Program program;
    train(program);
    ASSERT_EQ(program.run("export run -o out --format ply").exit_code, 0);
    const Gaussians own = read_ply(program.path("out/point_cloud.ply"));
    EXPECT_EQ(own.appearance.model, "sv");
    ASSERT_EQ(program.run("export run -o out --format splat").exit_code, 0);
    EXPECT_EQ(fs::file_size(program.path("out/point_cloud.splat")), 32u * std::size_t(own.count));
    const Outcome projected = program.run("export run -o sh --format ply --sh-projection");
    ASSERT_EQ(projected.exit_code, 0) << projected.err;
    EXPECT_NE(projected.err.find("dB over all directions"), std::string::npos) << projected.err;
    const Gaussians sh = read_ply(program.path("sh/point_cloud.ply"));
    EXPECT_EQ(sh.appearance.model, "sh");
    EXPECT_EQ(sh.count, own.count);
    EXPECT_NE(program.read("sh/point_cloud.ply").find("comment spherical harmonics fitted to the colours of sv, "),
              std::string::npos);
}

TEST(Export, TheEndingOfTheOutputNamesTheFormat) {
    const Program program;
    train_plain(program, "run", "-s builtin:glossy -r 8");
    ASSERT_EQ(program.run("export run -o model.ply").exit_code, 0);
    ASSERT_EQ(program.run("export model.ply -o model.splat --format splat").exit_code, 0);
    EXPECT_EQ(fs::file_size(program.path("model.splat")), 32u * std::size_t(read_ply(program.path("model.ply")).count));
    EXPECT_EQ(program.run("export run -o model.ply").exit_code, 2) << "it exists";
    EXPECT_EQ(program.run("export run -o model.ply --overwrite").exit_code, 0);
    for (const auto& [arguments, said] : {std::pair{"-o x.spz", "npx @playcanvas/splat-transform x.ply x.spz"},
                                          {"-o x.SOG", "npx @playcanvas/splat-transform x.ply x.SOG"},
                                          {"-o x.ksplat", "-o x.ply"},
                                          {"-o x.glb", "splat-transform"},
                                          {"-o x.ngsplat", "name a folder"},
                                          {"-o x.ply --format splat", "--format splat"},
                                          {"-o x.ply --format web", "--format web"},
                                          {"-o x --format spz", "splat-transform"}}) {
        const Outcome outcome = program.run("export run "s + arguments);
        EXPECT_EQ(outcome.exit_code, 2) << arguments << "\n" << outcome.err;
        EXPECT_NE(outcome.err.find(said), std::string::npos) << arguments << "\n" << outcome.err;
    }
    for (const char* name : {"x", "x.spz", "x.SOG", "x.ply"}) EXPECT_FALSE(fs::exists(program.path(name))) << name;
}

TEST(Export, TurnsWhatIsUp) {
    const Program program;
    train(program);
    train_plain(program, "plain", "-s builtin:glossy --eval -r 8");
    const Outcome refused = program.run("export run -o lobes --format ply --up y");
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_NE(refused.err.find("'sv' cannot be turned"), std::string::npos) << refused.err;
    EXPECT_FALSE(fs::exists(program.path("lobes")));
    for (const std::string run : {"run --sh-projection", "plain"}) {
        ASSERT_EQ(program.run("export -o as-is --overwrite --format ply " + run).exit_code, 0);
        ASSERT_EQ(program.run("export -o turned --overwrite --format ply --up y " + run).exit_code, 0);
        const Gaussians as_is = read_ply(program.path("as-is/point_cloud.ply")),
                        up = read_ply(program.path("turned/point_cloud.ply"));
        ASSERT_EQ(up.count, as_is.count);
        // The cameras of built-in scenes are level, and z is up.
        for (std::int64_t i = 0; i < up.count; ++i) {
            const float *p = as_is[Group::kMean].param.data() + 3 * i, *q = up[Group::kMean].param.data() + 3 * i;
            EXPECT_NEAR(q[0], p[0], 1e-5);
            EXPECT_NEAR(q[1], p[2], 1e-5);
            EXPECT_NEAR(q[2], -p[1], 1e-5);
        }
    }
    ASSERT_EQ(program.run("export run -o dots --format splat --up -y").exit_code, 0);
    float dot[3], turned_dot[3];
    ASSERT_EQ(program.run("export run -o as-is --format splat").exit_code, 0);
    std::memcpy(dot, program.read("as-is/point_cloud.splat").data(), sizeof dot);
    std::memcpy(turned_dot, program.read("dots/point_cloud.splat").data(), sizeof turned_dot);
    EXPECT_NEAR(turned_dot[1], -dot[2], 1e-5);
    EXPECT_NEAR(turned_dot[2], dot[1], 1e-5);

    // A site is turned with its cameras, so that its test views show what they showed.
    const auto psnr = [](const PackedScene& scene) {
        return parse_json(scene.trailer).at("test_views").at("packed_psnr").get<double>();
    };
    ASSERT_EQ(program.run("export plain -o site").exit_code, 0);
    ASSERT_EQ(program.run("export plain -o up --up=-y").exit_code, 0);
    const PackedScene as_is = read_ngsplat(program.path("site/scene.ngsplat")),
                      up = read_ngsplat(program.path("up/scene.ngsplat"));
    EXPECT_NEAR(as_is.up[2], 1, 0.05);
    EXPECT_NEAR(up.up[1], -1, 0.05);
    EXPECT_NEAR(psnr(up), psnr(as_is), 0.1) << "the same but for other rounding";
}

TEST(Export, APageHasATitleAStartViewAndAPictureForLinks) {
    if (viewer_folder().empty()) GTEST_SKIP() << "the web viewer is not built";
    const Program program;
    train_plain(program, "run", "-s builtin:glossy --eval -r 8");
    const Outcome plain = program.run("export run -o site");
    ASSERT_EQ(plain.exit_code, 0) << plain.err;
    const auto has = [&](const std::string& words) {
        const std::string page = program.read("site/index.html");
        EXPECT_NE(page.find(words), std::string::npos) << words << " in\n" << page.substr(0, 2500);
    };
    has("<title>glossy</title>");
    has("<meta property=\"og:title\" content=\"glossy\" />");
    has("<meta property=\"og:image\" content=\"preview.jpg\" />");
    EXPECT_EQ(program.read("site/index.html").find("gsapp:"), std::string::npos)
        << "nothing is said of title and start";
    const ImageInfo preview = read_image_info(program.path("site/preview.jpg"));
    EXPECT_EQ(std::pair(preview.width, preview.height), std::pair(1200, 630));
    const std::string before = program.read("site/preview.jpg");

    const Outcome titled = program.run(
        "export run -o site --overwrite --title 'Bowl & \"plate\"' --start-view 2 --url https://example.org/bowl/");
    ASSERT_EQ(titled.exit_code, 0) << titled.err;
    has("<title>Bowl &amp; &quot;plate&quot;</title>");
    has("<meta name=\"gsapp:title\" content=\"Bowl &amp; &quot;plate&quot;\" />");
    has("<meta name=\"gsapp:start\" content=\"view=2\" />");
    has("content=\"https://example.org/bowl/preview.jpg\"");
    EXPECT_NE(program.read("site/preview.jpg"), before) << "the picture shows what the page begins with";

    const auto starts = [&](const std::string& view) {
        const Outcome outcome = program.run("export run -o site --overwrite --start-view '" + view + "'");
        EXPECT_EQ(outcome.exit_code, 0) << view << "\n" << outcome.err;
        const std::string page = program.read("site/index.html"), sign = "\"gsapp:start\" content=\"";
        const std::size_t begin = page.find(sign) + sign.size();
        return page.substr(begin, page.find('"', begin) - begin);
    };
    EXPECT_EQ(starts("view=3&mode=depth"), "view=3&amp;mode=depth") << "as the page's own links";
    EXPECT_EQ(starts("http://127.0.0.1:8000/?model=a.ngsplat#from=0,0,3&to=0,0,0&fov=50"),
              "from=0,0,3&amp;to=0,0,0&amp;fov=50");
    const nlohmann::json cameras = parse_json(program.read("run/cameras.json"));
    const std::string test = cameras.at(0).at("img_name"), trained = cameras.back().at("img_name");
    EXPECT_EQ(starts(test), "view=1");
    EXPECT_EQ(starts(trained).rfind("from=", 0), 0u) << "photographs of the training are not in the page's list";
    for (const std::string view : {"nothing", "99999", "from=1,2&to=0,0,0", "a=<b>"}) {
        const Outcome outcome = program.run("export run -o other --start-view '" + view + "'");
        EXPECT_EQ(outcome.exit_code, 2) << view << "\n" << outcome.err;
        EXPECT_NE(outcome.err.find("--start-view " + view), std::string::npos) << outcome.err;
        EXPECT_FALSE(fs::exists(program.path("other"))) << view;
    }
    for (const std::string option :
         {"--title ' '", "--url example.org", "--url 'https://a/?b'", "--title x --format ply"})
        EXPECT_EQ(program.run("export run -o other " + option).exit_code, 2) << option;
}

TEST(Export, WhatCannotBeExportedLeavesNothing) {
    const Program program;
    const auto refused = [&](const std::string& arguments, int exit_code, const std::string& word) {
        const Outcome outcome = program.run(arguments);
        EXPECT_EQ(outcome.exit_code, exit_code) << arguments << "\n" << outcome.err;
        EXPECT_NE(outcome.err.find(word), std::string::npos) << arguments << "\n" << outcome.err;
        EXPECT_FALSE(fs::exists(program.path("out"))) << arguments;
    };
    refused("export nowhere -o out", 3, "nowhere");
    refused("export nowhere -o out --format ply", 3, "nowhere");
    refused("export nowhere -o out --format sog", 2, "sog");
    refused("export nowhere -o out --sh-projection", 2, "--format ply");
    refused("view out", 2, "out");
}

}  // namespace
}  // namespace gs
