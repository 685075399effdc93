// SPDX-License-Identifier: Apache-2.0
// A run knows its scene: from any folder, after either has moved, and where another scene lies in its place.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "tests/apps/program.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using test::Outcome;
using test::Program;

std::vector<std::string> names(int count) {
    std::vector<std::string> list;
    for (int i = 0; i < count; ++i) list.push_back("im" + std::to_string(10 + i) + ".png");
    return list;
}

/// Runs a command from a folder below the working one.
Outcome run_in(const Program& program, const std::string& folder, const std::string& arguments) {
    return program.run(arguments, "env -C '" + folder + "'");
}

/// A project: a scene of nine images and a run on it, which was named relative to the project's folder.
struct Project : Program {
    explicit Project(const std::string& appearance = "none") {
        test::write_colmap_scene(path("proj/scene"), names(9));
        fs::create_directory(path("other"));
        const Outcome outcome = run_in(*this, "proj",
                                       "train -s scene -m out --eval --device cpu --iterations 4 "
                                       "--checkpoint-iterations 2 --appearance " +
                                           appearance);
        EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    }
    void expect(const std::string& arguments, int exit_code, const std::string& message = "") const {
        const Outcome outcome = run(arguments);
        EXPECT_EQ(outcome.exit_code, exit_code) << arguments << "\n" << outcome.err;
        EXPECT_NE(outcome.err.find(message), std::string::npos) << arguments << "\n" << outcome.err;
    }
    std::string scores() const { return read("proj/out/results.json") + read("proj/out/per_view.json"); }
};

TEST(RunScene, IsFoundFromAnyFolder) {
    const Project project;
    // A scene of the same name in the folder of the call is not the run's.
    test::write_colmap_scene(project.path("other/scene"), names(12));
    for (const char* arguments : {"eval ../proj/out", "export ../proj/out -o site", "render ../proj/out -o pictures",
                                  "train -m ../proj/out --resume --iterations 6"}) {
        const Outcome outcome = run_in(project, "other", arguments);
        EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.err;
    }
    const std::string scene = fs::canonical(project.path("proj/scene")).string();
    EXPECT_NE(project.read("proj/out/cfg_args").find("source_path='" + scene + "'"), std::string::npos);
    EXPECT_NE(project.read("proj/out/config.yaml").find("source: " + scene), std::string::npos);
}

TEST(RunScene, IsFoundWhereItMovedWithTheRun) {
    const Project project;
    fs::rename(project.path("proj"), project.path("archive"));
    project.expect("eval archive/out", 0);
    project.expect("train -m archive/out --resume --iterations 6", 0);
    project.expect("bench -m archive/out --repeat 1 --frame-repeat 1", 0);
}

TEST(RunScene, IsAskedForWhereItIsGoneAndTakenFromTheCommandLine) {
    const Project project("sh");
    fs::rename(project.path("proj/scene"), project.path("moved"));
    const std::string before = project.scores();
    for (const char* arguments :
         {"eval proj/out", "export proj/out -o site", "render proj/out -o pictures", "bench frames proj/out",
          "bench -m proj/out", "train -m proj/out --resume --iterations 6"})
        project.expect(arguments, 3, "name where it is now with -s SCENE");
    EXPECT_EQ(project.scores(), before);
    project.expect("eval proj/out -s moved --metrics psnr", 0);
    EXPECT_FALSE(fs::exists(project.path("proj/out/on-moved"))) << "it is the run's own scene";
    for (const char* arguments :
         {"export proj/out -o site -s moved", "render proj/out -o pictures -s moved",
          "bench frames proj/out -s moved --frame-repeat 1", "bench -m proj/out -s moved --repeat 1 --frame-repeat 1",
          "train -m proj/out -s moved --resume --iterations 6"})
        project.expect(arguments, 0);
    project.expect("eval proj/out", 0);  // the resumed run has the new place
}

TEST(RunScene, ThatIsAnotherOneInTheSamePlaceIsRefusedByName) {
    const Project project("sh");
    fs::remove_all(project.path("proj/scene"));
    test::write_colmap_scene(project.path("proj/scene"), names(11));
    const std::string before = project.scores(), config = project.read("proj/out/config.yaml"),
                      cameras = project.read("proj/out/cameras.json");
    for (const char* arguments :
         {"eval proj/out", "eval proj/out -s proj/scene", "export proj/out -o site", "render proj/out -o pictures",
          "bench frames proj/out", "bench -m proj/out", "train -m proj/out --resume --iterations 6",
          "train -m proj/out -s proj/scene --resume --iterations 6",
          "train -m again --resume proj/out/checkpoints/iteration_2.safetensors -s proj/scene --iterations 6 --eval"})
        project.expect(arguments, 3, "it has 11 images, and the run has 9; 'im19.png' is not of the run");
    EXPECT_EQ(project.scores(), before);
    EXPECT_EQ(project.read("proj/out/config.yaml"), config);
    EXPECT_EQ(project.read("proj/out/cameras.json"), cameras);
    // Without a built viewer the command ends by itself afterwards.
    const Outcome viewed = project.interrupt("view proj/out --port 0", "no photographs are shown");
    EXPECT_NE(viewed.err.find("it has 11 images, and the run has 9"), std::string::npos) << viewed.err;
}

TEST(RunScene, AnotherOneThatIsNamedIsScoredApart) {
    const Project project;
    test::write_colmap_scene(project.path("large"), names(17));
    const std::string before = project.scores();
    project.expect("eval proj/out -s large", 0);
    EXPECT_EQ(project.scores(), before);
    EXPECT_EQ(parse_json(project.read("proj/out/on-large/results.json"))["protocol"]["ours_4"]["num_views"], 3);
    project.expect("train -m proj/out -s large --resume --iterations 6", 3, "17 images");
    project.expect("eval proj/out/point_cloud/iteration_4/point_cloud.ply -s large", 0);
    // Also if its own is gone.
    fs::remove_all(project.path("proj/scene"));
    project.expect("eval proj/out -s large", 0);
    EXPECT_EQ(project.scores(), before);
}

TEST(RunScene, OfARunWithoutTheListOfItsViewsIsNotCompared) {
    const Project project;
    fs::remove(project.path("proj/out/cameras.json"));
    test::write_colmap_scene(project.path("proj/scene"), names(11));
    project.expect("eval proj/out", 0);
}

TEST(RunScene, ABuiltInOneHasToBeTheSameToo) {
    const Program program;
    ASSERT_EQ(program.run("train -s builtin:diffuse -m run --device cpu -r 8 --iterations 2").exit_code, 0);
    const Outcome other = program.run("train -m run -s builtin:glossy --resume --iterations 4");
    EXPECT_EQ(other.exit_code, 3) << other.err;
    EXPECT_NE(other.err.find("the run has builtin:diffuse"), std::string::npos) << other.err;
    EXPECT_EQ(program.run("train -m run --resume --iterations 4").exit_code, 0);
}

TEST(RunScene, ChangedInItsPlaceDoesNotMixIntoATradeoff) {
    const Program program;
    test::write_colmap_scene(program.path("scene"), names(9));
    const std::string command =
        "tradeoff -s scene --device cpu --cap-max 100 -m out --axes appearance=none,sh --iterations 2";
    ASSERT_EQ(program.run(command).exit_code, 0);
    EXPECT_EQ(program.run(command).exit_code, 0);
    test::write_colmap_scene(program.path("scene"), names(10));
    const Outcome changed = program.run(command);
    EXPECT_EQ(changed.exit_code, 2) << changed.err;
    EXPECT_NE(changed.err.find("10 images, and the run has 9"), std::string::npos) << changed.err;
    EXPECT_EQ(program.run(command + " --overwrite").exit_code, 0);
}

std::string all_bytes(const fs::path& folder) {
    std::string text;
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files)
        text += file.string() + "\n" + (fs::is_regular_file(file) ? test::slurp(file) : "");
    return text;
}

TEST(OutputFolder, InsideOfASceneReplacesNothing) {
    const Program program;
    std::vector<std::string> images = names(9);
    images.push_back("comparison.png");
    test::write_colmap_scene(program.path("scene"), images);
    program.folder().write("scene/config.yaml", "iterations: 7\n");
    const std::string before = all_bytes(program.path("scene"));
    const std::string train = "train -s scene --eval --device cpu --iterations 2 -m ";
    for (const char* folder : {"scene", "scene/images", "scene/images/", "scene/sparse"}) {
        const Outcome outcome = program.run(train + folder);
        EXPECT_EQ(outcome.exit_code, 2) << folder << outcome.err;
        EXPECT_EQ(all_bytes(program.path("scene")), before) << folder;
    }
    for (const char* folder : {"scene", "scene/images"}) {
        const Outcome outcome = program.run(train + folder + " --overwrite");
        EXPECT_EQ(outcome.exit_code, 2) << folder << outcome.err;
        EXPECT_NE(outcome.err.find("--overwrite replaces runs alone"), std::string::npos) << outcome.err;
        EXPECT_EQ(all_bytes(program.path("scene")), before) << folder;
    }
    EXPECT_EQ(program.run(train + "scene/output").exit_code, 0) << "a folder of its own is as good as any";
    EXPECT_EQ(program.run(train + "scene/output --overwrite").exit_code, 0);
}

TEST(OutputFolder, IsRefusedBeforeTheSceneIsLoaded) {
    const Program program;
    fs::create_directory(program.path("run"));
    program.folder().write("run/notes.txt", "mine");
    const Outcome outcome = program.run("train -s nowhere -m run");
    EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
    EXPECT_NE(outcome.err.find("'run' is not empty and holds no run ('notes.txt' is there)"), std::string::npos)
        << outcome.err;
    EXPECT_EQ(program.run("train -s nowhere -m run --overwrite").exit_code, 3);
    program.folder().write("run/notes.txt", "");
    EXPECT_EQ(program.run("train -s builtin:diffuse --device cpu -r 8 --iterations 2 -m run 2>run/messages").exit_code,
              0)
        << "empty files are the shell's";
}

}  // namespace
}  // namespace gs
