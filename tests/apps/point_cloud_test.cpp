// SPDX-License-Identifier: Apache-2.0
// eval, render, export and bench of a .ply file that has no run.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <sstream>

#include "lib/core/json_text.h"
#include "lib/export/ngsplat.h"
#include "lib/io/image.h"
#include "lib/model/ply.h"
#include "tests/apps/program.h"
#include "tests/core/test_data.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using test::Outcome;
using test::Program;

/// The options by which the views of the run are loaded.
constexpr const char* kScene = "-s builtin:glossy -r 4 -w";

/// Trains `run` and copies its model to model.ply, as somebody would who keeps that file alone.
void train_model(const Program& program, const std::string& arguments) {
    program.train("run", "--eval --iterations 20 --init-points 400 " + arguments);
    fs::copy_file(program.path("run/point_cloud/iteration_20/point_cloud.ply"), program.path("model.ply"));
}

Outcome expect_run(const Program& program, const std::string& arguments) {
    Outcome outcome = program.run(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.err;
    return outcome;
}

void expect_wrong(const Program& program, const std::string& arguments, int exit_code, const std::string& reason) {
    const Outcome outcome = program.run(arguments);
    EXPECT_EQ(outcome.exit_code, exit_code) << arguments << "\n" << outcome.err;
    EXPECT_NE(outcome.err.find(reason), std::string::npos) << arguments << "\n" << outcome.err;
    EXPECT_EQ(outcome.out, "") << arguments;
}

/// The names in the working folder, but for what the calls print.
std::set<std::string> names(const Program& program) {
    std::set<std::string> all;
    for (const auto& entry : fs::directory_iterator(program.folder().path())) all.insert(entry.path().filename());
    all.erase("out.txt"), all.erase("err.txt");
    return all;
}

/// The only line of the table that `gsapp eval --format json` prints, of which every column is a number.
nlohmann::json scores(const Program& program, const std::string& arguments) {
    const Outcome outcome = expect_run(program, "eval --format json " + arguments);
    return parse_json(outcome.out).at("tables").at(0).at("lines").at(0);
}

/// Takes the comments out of a PLY: what is left is a file as 3DGS's trainer writes it.
void strip_comments(const Program& program, const std::string& from, const std::string& to) {
    const std::string file = program.read(from);
    const std::string end = "end_header\n";
    const auto body = file.find(end) + end.size();
    std::istringstream header(file.substr(0, body));
    std::string stripped;
    for (std::string line; std::getline(header, line);)
        if (!line.starts_with("comment ")) stripped += line + "\n";
    program.folder().write(to, stripped + file.substr(body));
}

TEST(PointCloud, ScoresAsItsRunDoesAndLeavesNothing) {
    const Program program;
    train_model(program, std::string(kScene) + " --appearance sv");
    const auto before = names(program);
    const nlohmann::json of_run = scores(program, "run"), of_file = scores(program, std::string("model.ply ") + kScene);
    EXPECT_EQ(of_file.at("values").at("PSNR"), of_run.at("values").at("PSNR")) << of_file << of_run;
    EXPECT_EQ(of_file.at("values").at("SSIM"), of_run.at("values").at("SSIM"));
    EXPECT_EQ(of_file.at("model"), "sv");
    EXPECT_EQ(names(program), before);
    EXPECT_NE(scores(program, "model.ply -s builtin:glossy -r 4").at("values").at("PSNR"),
              of_run.at("values").at("PSNR"))
        << "on black";
    EXPECT_EQ(names(program), before);

    // Where an output is named, it is as a run's results, and eval reads it again.
    expect_run(program, std::string("eval model.ply -o kept ") + kScene);
    EXPECT_TRUE(fs::exists(program.path("kept/per_view.json")));
    EXPECT_EQ(program.read("kept/test/ours_0/renders/00003.png"), program.read("run/test/ours_20/renders/00003.png"));
    EXPECT_EQ(scores(program, "--skip-render kept").at("values").at("PSNR"), of_run.at("values").at("PSNR"));
    expect_run(program,
               std::string("eval model.ply run/point_cloud/iteration_20/point_cloud.ply --html page.html ") + kScene);
    EXPECT_NE(program.read("page.html").find("data:image/jpeg"), std::string::npos) << "pictures are in the page";
    EXPECT_FALSE(fs::exists(program.path("run/point_cloud/iteration_20/results.json")));
}

TEST(PointCloud, IsRenderedFromCamerasOfAnyOrigin) {
    const Program program;
    train_model(program, std::string(kScene) + " --appearance none");
    expect_run(program, std::string("render model.ply -o views ") + kScene);
    expect_run(program, "render run -o of-run");
    EXPECT_EQ(program.read("views/00003.png"), program.read("of-run/00003.png"));
    expect_run(program, "render run -s builtin:glossy -o moved");
    EXPECT_EQ(program.read("moved/00003.png"), program.read("of-run/00003.png"));
    fs::remove_all(program.path("moved"));
    expect_run(program, "render model.ply -o path -w --path run/cameras.json");
    EXPECT_EQ(program.read("path/00003.png"), program.read("of-run/00003.png")) << "no scene is needed";

    // An orbit without a scene shows the model in the middle and nothing at the sides.
    expect_run(program, "render model.ply -o orbit --orbit 3 --orbit-up z --background 0,0,1");
    const Image picture = read_image(program.path("orbit/00001.png"));
    ASSERT_EQ(picture.width, 1280);
    const auto shown = [&](int left, int right) {
        int count = 0;
        for (int y = 0; y < 720; ++y)
            for (int x = left; x < right; ++x) count += picture.value(x, y, 2) < 0.95f;
        return count;
    };
    EXPECT_GT(shown(300, 980), 1000);
    EXPECT_EQ(shown(0, 40) + shown(1240, 1280), 0);
    expect_run(program, "render model.ply -o other --orbit 3 --background 0,0,1");
    EXPECT_NE(program.read("other/00001.png"), program.read("orbit/00001.png")) << "-y is up";
    EXPECT_EQ(names(program), (std::set<std::string>{"model.ply", "run", "views", "of-run", "path", "orbit", "other"}));
}

/// Replaces a column of a PLY without comments, in rows 0, `step`, 2 `step`, ...
void put(const Program& program, const std::string& from, const std::string& to, const std::string& column, float value,
         std::size_t step) {
    std::string file = program.read(from);
    const std::size_t body = file.find("end_header\n") + 11;
    std::istringstream header(file.substr(0, body));
    std::size_t columns = 0, at = 0;
    for (std::string line; std::getline(header, line);) {
        if (!line.starts_with("property")) continue;
        if (line.ends_with(" " + column)) at = columns;
        ++columns;
    }
    const std::size_t rows = (file.size() - body) / (4 * columns);
    for (std::size_t i = 0; i < rows; i += step) std::memcpy(&file[body + 4 * (i * columns + at)], &value, 4);
    program.folder().write(to, file);
}

TEST(PointCloud, IsExportedWithAndWithoutAScene) {
    const Program program;
    train_model(program, std::string(kScene) + " --appearance sv");
    expect_run(program, "export model.ply -o bare");
    const PackedScene bare = read_ngsplat(program.path("bare/scene.ngsplat"));
    EXPECT_TRUE(bare.cameras.empty());
    EXPECT_EQ(bare.trailer.find("test_views"), std::string::npos);
    EXPECT_EQ(parse_json(bare.trailer).at("scene"), "model");
    expect_run(program, "export run -o of-run");
    expect_run(program, std::string("export model.ply -o seen --photographs ") + kScene);
    EXPECT_TRUE(fs::exists(program.path("seen/photographs")));
    const auto measured = [&](const char* file) {
        return parse_json(read_ngsplat(program.path(file)).trailer).at("test_views");
    };
    EXPECT_EQ(measured("seen/scene.ngsplat"), measured("of-run/scene.ngsplat"));
    expect_run(program, "export model.ply -o sh --format ply --sh-projection");
    EXPECT_EQ(read_ply(program.path("sh/point_cloud.ply")).appearance.model, "sh");
    expect_run(program, "export model.ply -o turned --format splat --up y -s builtin:glossy");
    expect_run(program, "export run -o turned-run --format splat --up y");
    EXPECT_EQ(program.read("turned/point_cloud.splat"), program.read("turned-run/point_cloud.splat"));
    // A reader of this file warns each time.
    strip_comments(program, "model.ply", "nan.ply");
    put(program, "nan.ply", "nan.ply", "f_dc_0", std::nanf(""), 7);
    const std::string messages =
        expect_run(program, "export nan.ply -o nan --format ply --up y -s builtin:glossy --sh-projection").err;
    const auto warning = messages.find("are left out");
    EXPECT_NE(warning, std::string::npos) << messages;
    EXPECT_EQ(messages.find("are left out", warning + 1), std::string::npos) << "read once\n" << messages;
    expect_wrong(program, "export model.ply -o x --format splat --up y", 2, "--source");
    expect_wrong(program, "export model.ply -o x --photographs", 2, "--source");
    EXPECT_FALSE(fs::exists(program.path("x")));
}

TEST(PointCloud, IsMeasuredWithAScene) {
    const Program program;
    train_model(program, std::string(kScene) + " --appearance sv");
    const auto before = names(program);
    for (const char* arguments : {"bench model.ply -s builtin:glossy -r 8 --repeat 1 --frame-repeat 1",
                                  "bench -m model.ply builtin:glossy -r 8 --repeat 1 --frame-repeat 1",
                                  "bench precision model.ply -s builtin:glossy -r 8 --repeat 1 --frame-repeat 1"}) {
        const Outcome outcome = expect_run(program, arguments);
        EXPECT_TRUE(outcome.out.starts_with("builtin:glossy, model.ply\n")) << arguments << "\n" << outcome.out;
    }
    const Outcome frames = expect_run(program, "bench frames model.ply -s builtin:glossy -r 8 --frame-repeat 1");
    EXPECT_NE(frames.out.find("| model.ply | glossy | sv "), std::string::npos) << frames.out;
    EXPECT_EQ(names(program), before);
    const Outcome points = expect_run(program, "bench builtin:glossy -r 8 --repeat 1 --frame-repeat 1 --device cpu");
    EXPECT_TRUE(points.out.starts_with("builtin:glossy, initial points\n")) << "a word that is no .ply is the scene";
}

TEST(PointCloud, OfAnotherProgramIsTakenAsItIs) {
    const Program program;
    train_model(program, std::string(kScene) + " --appearance sh");
    strip_comments(program, "model.ply", "foreign.ply");
    ASSERT_EQ(program.read("foreign.ply").find("comment"), std::string::npos);
    const nlohmann::json own = scores(program, std::string("model.ply ") + kScene).at("values"),
                         foreign = scores(program, std::string("foreign.ply ") + kScene).at("values");
    EXPECT_NEAR(foreign.at("PSNR").at("mean"), own.at("PSNR").at("mean"), 0.01);
    const Outcome orbit = expect_run(program, "render foreign.ply --orbit 2 -o orbit");
    EXPECT_EQ(orbit.err.find("warning"), std::string::npos) << orbit.err;
    expect_run(program, "export foreign.ply -o site");
    std::string antialiased = program.read("foreign.ply");
    antialiased.insert(antialiased.find("element"), "comment SplatRenderMode: mip\n");
    program.folder().write("antialiased.ply", antialiased);
    expect_run(program, "render antialiased.ply --orbit 2 -o mip");
    EXPECT_NE(program.read("mip/00001.png"), program.read("orbit/00001.png"));
    expect_run(program, "export antialiased.ply -o again.ply");
    EXPECT_NE(program.read("again.ply").find("comment SplatRenderMode: mip\n"), std::string::npos);
}

TEST(PointCloud, InfiniteOpacitiesAndScalesAreShownAsTheirLimits) {
    const Program program;
    train_model(program, std::string(kScene) + " --appearance sh");
    strip_comments(program, "model.ply", "model.ply");
    const float infinity = std::numeric_limits<float>::infinity();
    put(program, "model.ply", "opaque.ply", "opacity", infinity, 2);
    put(program, "opaque.ply", "opaque.ply", "scale_1", -infinity, 3);
    put(program, "opaque.ply", "opaque.ply", "opacity", -infinity, 5);
    put(program, "model.ply", "large.ply", "opacity", 80, 2);
    put(program, "large.ply", "large.ply", "scale_1", -90, 3);
    put(program, "large.ply", "large.ply", "opacity", -80, 5);
    for (const char* name : {"opaque", "large"}) {
        expect_run(program, std::string("render ") + name + ".ply -o " + name + " " + kScene);
        expect_run(program, std::string("export ") + name + ".ply -o " + name + ".splat");
        expect_run(program, std::string("export ") + name + ".ply -o " + name + "-site");
    }
    EXPECT_EQ(program.read("opaque/00003.png"), program.read("large/00003.png"));
    EXPECT_EQ(program.read("opaque.splat").size(), program.read("large.splat").size());
    const PackedScene packed = read_ngsplat(program.path("opaque-site/scene.ngsplat"));
    EXPECT_EQ(packed.count(), read_ngsplat(program.path("large-site/scene.ngsplat")).count());
    const auto flat = [](const GeometryWords& words) {
        return (words[3] & 0xff) == 0 || (words[3] >> 8 & 0xff) == 0 || (words[3] >> 16 & 0xff) == 0;
    };
    EXPECT_GT(std::count_if(packed.geometry.begin(), packed.geometry.end(), flat), 0) << "no extent at all";
    expect_run(program, "export opaque.ply -o again.ply");
    const auto num_opaque = [&](const char* file) {
        const Gaussians gaussians = read_ply(program.path(file));
        return std::ranges::count(gaussians[Group::kOpacity].param, infinity);
    };
    EXPECT_GT(num_opaque("opaque.ply"), 0);
    EXPECT_EQ(num_opaque("again.ply"), num_opaque("opaque.ply"));
    const Outcome trained =
        expect_run(program, std::string("train --device cpu --iterations 20 -m on --init opaque.ply ") + kScene);
    EXPECT_NE(trained.err.find("have no gradient and begin as large finite ones"), std::string::npos) << trained.err;
    const Gaussians after = read_ply(program.path("on/point_cloud/iteration_20/point_cloud.ply"));
    for (const float x : after[Group::kOpacity].param) EXPECT_TRUE(std::isfinite(x));
    // A file of which some rows are no Gaussians shows the others.
    put(program, "model.ply", "nan.ply", "f_dc_0", std::nanf(""), 7);
    EXPECT_NE(expect_run(program, std::string("render nan.ply -o nan ") + kScene).err.find("are left out"),
              std::string::npos);
    put(program, "model.ply", "nothing.ply", "x", std::nanf(""), 1);
    expect_wrong(program, std::string("render nothing.ply -o x ") + kScene, 3, "nothing.ply': none of its");
}

TEST(PointCloud, OfOtherKindsSaysWhatItIsForEveryCommand) {
    const Program program;
    program.folder().write("scene.spz", "\x1f\x8b\x08 and so on");
    program.folder().write("points.ply",
                           "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float "
                           "y\nproperty float z\nend_header\n0 0 0\n");
    for (const auto& [file, said] : {std::pair{"scene.spz", "npx @playcanvas/splat-transform scene.spz scene.ply"},
                                     {"points.ply", "it is a point cloud, not a model of Gaussians"}})
        for (const char* arguments :
             {"eval ", "eval -s builtin:glossy ", "render --orbit 2 -o x ", "render --orbit 2 ", "export -o x ",
              "export --format ply -o x ", "view --port 0 ", "bench -s builtin:glossy ", "bench ",
              "bench precision -s builtin:glossy ", "bench frames -s builtin:glossy ",
              "train -s builtin:glossy -r 8 --device cpu -m x --init "})
            expect_wrong(program, std::string(arguments) + file, 3, said);
}

TEST(PointCloud, OfAPhotographedSceneScoresAsItsRunDoes) {
    const fs::path scene = test::test_data("tiny/bonsai");
    if (scene.empty()) GTEST_SKIP() << "no tiny/bonsai in GSAPP_TEST_DATA";
    const Program program;
    train_model(program, "-s '" + scene.string() + "' --appearance sh");
    strip_comments(program, "model.ply", "foreign.ply");
    const nlohmann::json run = scores(program, "run").at("values"),
                         own = scores(program, "model.ply -s '" + scene.string() + "'").at("values"),
                         foreign = scores(program, "foreign.ply -s '" + scene.string() + "'").at("values");
    EXPECT_EQ(own.at("PSNR"), run.at("PSNR"));
    EXPECT_NEAR(foreign.at("PSNR").at("mean"), run.at("PSNR").at("mean"), 0.01) << "without the frame's comment";
}

TEST(PointCloud, WhatIsMissingOrWrongIsNamed) {
    const Program program;
    train_model(program, std::string(kScene) + " --appearance none");
    const auto before = names(program);
    for (const char* arguments : {"eval model.ply", "render model.ply -o x", "bench model.ply", "bench -m model.ply",
                                  "bench precision model.ply", "bench frames model.ply"})
        expect_wrong(program, arguments, 2, "'model.ply' is a point cloud without a run, which has no views");
    expect_wrong(program, "render model.ply --orbit 2", 2, "--output");
    expect_wrong(program, "render model.ply --orbit 2 -o x --show appearance", 2, "--source");
    expect_wrong(program, "eval model.ply --iteration 20 -s builtin:glossy", 2, "--iteration 20");
    expect_wrong(program, "eval model.ply --skip-render -s builtin:glossy", 2, "--skip-render");
    expect_wrong(program, "eval model.ply run -o x -s builtin:glossy", 2, "--output");
    expect_wrong(program, "eval model.ply -s builtin:glossy -r 3", 2, "resolution");
    expect_wrong(program, "eval model.ply -s builtin:glossy --eval=false", 2, "no test views");
    expect_wrong(program, "eval run -r 8", 2, "--resolution: goes with a .ply file");
    expect_wrong(program, "render run --background 0,0,1", 2, "--background: goes with a .ply file");
    program.folder().write("text.ply", "hello\n");
    program.folder().write("picture.png", "hello\n");
    for (const char* file : {"text.ply", "picture.png", "missing.ply"})
        for (const char* arguments : {"eval ", "eval -s builtin:glossy ", "render --orbit 2 -o x ", "export -o x ",
                                      "export --format splat -o x ", "bench frames -s builtin:glossy "})
            expect_wrong(program, std::string(arguments) + file, 3, file);
    fs::remove(program.path("text.ply")), fs::remove(program.path("picture.png"));
    EXPECT_EQ(names(program), before);
}

}  // namespace
}  // namespace gs
