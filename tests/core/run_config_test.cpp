// SPDX-License-Identifier: Apache-2.0
// Paths that a run stores are found again from elsewhere and after a move.
#include "lib/core/run_config.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "lib/core/options.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

TEST(RunConfig, PathsAreAbsolute) {
    const std::string here = fs::current_path().string();
    EXPECT_EQ(absolute_path("scene"), here + "/scene");
    EXPECT_EQ(absolute_path("./a/../scene/"), here + "/scene");
    EXPECT_EQ(absolute_path("/data/scene"), "/data/scene");
    EXPECT_EQ(absolute_path("/"), "/");
    EXPECT_EQ(absolute_path(""), "");
    EXPECT_EQ(absolute_path("builtin:glossy"), "builtin:glossy");
    EXPECT_EQ(absolute_path("builtin:my.yaml"), "builtin:" + here + "/my.yaml");
    const TemporaryFolder folder;
    fs::create_directories(folder.path() / "a/b");
    fs::create_directory_symlink("a/b", folder.path() / "link");
    EXPECT_EQ(absolute_path((folder.path() / "link/../x").string()), (folder.path() / "x").string());
    fs::create_directory(folder.path() / "a/x");
    EXPECT_EQ(absolute_path((folder.path() / "link/../x").string()), (folder.path() / "link/../x").string())
        << "after a link the path without dots is another place";
}

TEST(RunConfig, FilesThatMovedWithTheRunAreFound) {
    const TemporaryFolder folder;
    const fs::path project = folder.path() / "project", archive = folder.path() / "archive";
    fs::create_directories(project / "scene");
    fs::create_directories(project / "runs/one");
    folder.write("project/list.txt", "a.png\n");
    folder.write("project/own.yaml", "");
    TrainOptions options;
    options.source = (project / "scene").string();
    options.test_list = (project / "list.txt").string();
    options.init = (folder.path() / "gone.ply").string();
    options.model = (project / "runs/one").string();
    folder.write("project/runs/one/config.yaml", run_config(options));
    EXPECT_EQ(load_run_options(project / "runs/one").source, project / "scene");
    fs::rename(project, archive);
    TrainOptions moved = load_run_options(archive / "runs/one");
    EXPECT_EQ(moved.source, archive / "scene");
    EXPECT_EQ(moved.test_list, archive / "list.txt");
    EXPECT_EQ(moved.init, options.init) << "what is nowhere keeps its name";
    options.source = "builtin:" + (project / "own.yaml").string();
    folder.write("archive/runs/one/config.yaml", run_config(options));
    EXPECT_EQ(load_run_options(archive / "runs/one").source, "builtin:" + (archive / "own.yaml").string());
    EXPECT_TRUE(scene_exists("builtin:glossy"));
    EXPECT_FALSE(scene_exists(options.source));
}

TEST(RunConfig, RelativePathsOfOlderRunsStay) {
    const TemporaryFolder folder;
    folder.write("config.yaml", "source: scene\nmodel: out\n");
    EXPECT_EQ(load_run_options(folder.path()).source, "scene");
    folder.write("config.yaml", "source: scene\nmodel: " + folder.path().string() + "\n");
    EXPECT_EQ(load_run_options(folder.path()).source, "scene");
}

}  // namespace
}  // namespace gs
