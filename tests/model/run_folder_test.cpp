// SPDX-License-Identifier: Apache-2.0
// The run folder: what protects earlier results, and the small files 3DGS tools read.
#include "lib/model/run_folder.h"

#include <sys/wait.h>
#include <unistd.h>
#include <csignal>
#include <cstring>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/io/atomic_file.h"
#include "lib/io/ply_file.h"
#include "lib/model/cameras_json.h"
#include "tests/io/file_helpers.h"
#include "tests/io/limits.h"

namespace gs::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kConfig = "# gsapp 0.0.1\nseed: 1\n";  // as gsapp begins it

/// Lists the files below `root`: relative, sorted, separated by blanks.
std::string listing(const fs::path& root) {
    std::vector<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(root))
        names.push_back(fs::relative(entry.path(), root).string());
    std::sort(names.begin(), names.end());
    std::string text;
    for (const auto& name : names) text += (text.empty() ? "" : " ") + name;
    return text;
}

void write_run(const RunFolder& run, std::int64_t iteration) {
    for (const fs::path& path :
         {run.config(), run.cfg_args(), run.cameras(), run.input_points(), run.results(), run.per_view(),
          run.train_log(), run.point_cloud(iteration), run.checkpoint(iteration), run.preview(iteration),
          run.render("test", iteration, 3), run.ground_truth("test", iteration, 3),
          run.picture_part("test", iteration, "base", 3), run.picture_part("test", iteration, "residual", 3)}) {
        spit(path, "x");
    }
    spit(run.config(), kConfig);
}

TEST(RunFolder, PathsAreThoseOf3dgs) {
    const RunFolder run{"out"};
    EXPECT_EQ(run.point_cloud(30000), "out/point_cloud/iteration_30000/point_cloud.ply");
    EXPECT_EQ(run.checkpoint(7), "out/checkpoints/iteration_7.safetensors");
    EXPECT_EQ(run.render("test", 7000, 12), "out/test/ours_7000/renders/00012.png");
    EXPECT_EQ(run.ground_truth("train", 7000, 12), "out/train/ours_7000/gt/00012.png");
    EXPECT_EQ(run.picture_part("test", 7000, "residual", 12), "out/test/ours_7000/residual/00012.png");
    EXPECT_EQ(run.preview(500), "out/preview/000500.png");
}

TEST(RunFolder, NewAndEmptyFoldersAreAccepted) {
    const TempFolder folder;
    const RunFolder run{folder / "a/b"};
    prepare_run_folder(run, false);
    prepare_run_folder(run, false);
    EXPECT_EQ(listing(run.root), "");
    spit(run.root / "messages.txt", "");
    spit(run.root / ".hidden", "x");
    spit(run.root / "gsapp.log", "x");  // of a run that was killed while it looked for a model
    spit(run.appearance_choice(), "x");
    prepare_run_folder(run, false);
    prepare_run_folder(run, true);
}

TEST(RunFolder, FolderWithOtherFilesIsRefusedAndNeverLosesThem) {
    const TempFolder folder;
    const RunFolder run{folder / "run"};
    spit(run.root / "notes.txt", "mine");
    EXPECT_CONTAINS(message_of<UsageError>([&] { prepare_run_folder(run, false); }), "'notes.txt' is there");
    prepare_run_folder(run, true);
    for (const char* file :
         {"config.yaml", "cfg_args", "cameras.json", "input.ply", "results.json", "per_view.json", "ppisp.json",
          "auto.json", "comparison.png", "stats/train.jsonl", "point_cloud/iteration_30/point_cloud.ply",
          "checkpoints/iteration_30.safetensors", "preview/000500.png", "test/ours_30/renders/00001.png"}) {
        const RunFolder other{folder / std::to_string(std::hash<std::string>()(file))};
        spit(other.root / file, "mine");
        for (const bool overwrite : {false, true}) {
            EXPECT_CONTAINS(message_of<UsageError>([&] { require_free_run_folder(other, overwrite); }),
                            other.root.string());
            EXPECT_THROW(prepare_run_folder(other, overwrite), UsageError) << file;
        }
        EXPECT_EQ(slurp(other.root / file), "mine");
    }
}

TEST(RunFolder, FolderWithARunIsRefused) {
    const TempFolder folder;
    for (const char* file :
         {"gsapp.log", "point_cloud/iteration_30/point_cloud.ply", "checkpoints/iteration_30.safetensors"}) {
        const RunFolder run{folder / std::to_string(std::hash<std::string>()(file))};
        spit(run.root / file, "x");
        spit(run.config(), kConfig);
        const std::string before = listing(run.root);
        const std::string message = message_of<UsageError>([&] { prepare_run_folder(run, false); });
        EXPECT_CONTAINS(message, run.root.string());
        EXPECT_CONTAINS(message, "--overwrite");
        EXPECT_EQ(listing(run.root), before);
    }
}

TEST(RunFolder, OverwriteRemovesTheRunAndKeepsUserFiles) {
    const TempFolder folder;
    const RunFolder run{folder / "run"};
    write_run(run, 30);
    spit(run.root / "notes.txt", "mine");
    spit(run.root / "point_cloud/iteration_30/edited.ply", "mine");
    spit(run.root / "test/ours_30/renders/best.png", "mine");
    spit(run.root / "checkpoints/iteration_.safetensors", "mine");
    spit(run.root / "checkpoints/iteration_3a.safetensors", "mine");
    prepare_run_folder(run, true);
    replace_earlier_run(run, "new");
    EXPECT_EQ(
        listing(run.root),
        "checkpoints checkpoints/iteration_.safetensors checkpoints/iteration_3a.safetensors config.yaml notes.txt "
        "point_cloud "
        "point_cloud/iteration_30 "
        "point_cloud/iteration_30/edited.ply test test/ours_30 test/ours_30/renders test/ours_30/renders/best.png");
}

TEST(RunFolder, OverwriteLeavesNothingOfARunAlone) {
    const TempFolder folder;
    const RunFolder run{folder / "run"};
    write_run(run, 30);
    prepare_run_folder(run, true);
    replace_earlier_run(run, "new");
    EXPECT_EQ(listing(run.root), "config.yaml");
    EXPECT_EQ(slurp(run.config()), "new");
}

TEST(RunFolder, OverwriteOnAFullDiskLeavesTheEarlierRun) {
    const TempFolder folder;
    const RunFolder run{folder / "run"};
    write_run(run, 30);
    const std::string before = listing(run.root);
    const int status = in_child([&] {
        limit_file_size(0);
        prepare_run_folder(run, true);
        return data_error_status([&] { replace_earlier_run(run, "new"); }, "config.yaml", "File too large");
    });
    EXPECT_EQ(status, 0);
    EXPECT_EQ(listing(run.root), before);
    EXPECT_EQ(slurp(run.config()), kConfig);
}

TEST(RunFolder, LeftoversOfKilledRunsGo) {
    const TempFolder folder;
    const RunFolder run{folder / "run"};
    write_run(run, 30);
    const std::string before = listing(run.root);
    for (const char* name :
         {".config.yaml.12-0.tmp", "checkpoints/.iteration_30.safetensors.12-1.tmp",
          "point_cloud/iteration_30/.point_cloud.ply.12-2.tmp", "test/ours_30/gt/.00003.png.1-3.tmp"})
        spit(run.root / name, "x");
    spit(run.root / "mine/.a.12-0.tmp", "x");
    EXPECT_THROW(prepare_run_folder(run, false), UsageError);
    EXPECT_TRUE(fs::exists(run.root / "mine/.a.12-0.tmp"));
    fs::remove_all(run.root / "mine");
    EXPECT_EQ(listing(run.root), before);
}

TEST(RunFolder, ResumingKeepsEarlierAndProtectsLaterResults) {
    const TempFolder folder;
    const RunFolder run{folder / "run"};
    write_run(run, 30);
    write_run(run, 60);
    const std::string before = listing(run.root);
    prepare_run_folder(run, false, 60);
    EXPECT_EQ(listing(run.root), before);
    const std::string message = message_of<UsageError>([&] { prepare_run_folder(run, false, 30); });
    EXPECT_CONTAINS(message, "iteration 60");
    EXPECT_CONTAINS(message, "iteration 30");
    EXPECT_EQ(listing(run.root), before);
    prepare_run_folder(run, true, 30);
    replace_earlier_run(run, "new", 30);
    EXPECT_FALSE(fs::exists(run.point_cloud(60)));
    EXPECT_FALSE(fs::exists(run.checkpoint(60)));
    EXPECT_TRUE(fs::exists(run.point_cloud(30)));
    EXPECT_TRUE(fs::exists(run.checkpoint(30)));
    EXPECT_TRUE(fs::exists(run.config()));
}

TEST(RunFolder, AKilledRunResumesWhereItHasSavedSinceItsLastCheckpoint) {
    const TempFolder folder;
    const RunFolder run{folder / "run"}, other{folder / "other"};
    write_run(run, 30);
    spit(run.point_cloud(40), "x");
    const std::string before = listing(run.root);
    prepare_run_folder(run, false, 30);
    EXPECT_EQ(listing(run.root), before);
    spit(other.point_cloud(40), "x");
    spit(other.config(), kConfig);
    EXPECT_CONTAINS(message_of<UsageError>([&] { prepare_run_folder(other, false, 30); }), "iteration 40");
}

TEST(RunFolder, ARunKilledBeforeItsFirstCheckpointIsToBeStartedAnew) {
    const TempFolder folder;
    const RunFolder run{folder / "run"};
    TrainOptions options;
    options.source = "builtin:diffuse", options.iterations = 100;
    spit(run.config(), options_to_yaml(options));
    EXPECT_CONTAINS(message_of<DataError>([&] { latest_checkpoint(run.root); }), "--overwrite in place of --resume");
    spit(run.point_cloud(50), "x");  // of --save-iterations
    EXPECT_CONTAINS(message_of<DataError>([&] { latest_checkpoint(run.root); }), "ended before the first checkpoint;");
    spit(run.point_cloud(100), "x");
    EXPECT_CONTAINS(message_of<DataError>([&] { latest_checkpoint(run.root); }), "its run is complete, but");
    options.time_limit = parse_duration("5s", "");
    spit(run.config(), options_to_yaml(options));
    EXPECT_CONTAINS(message_of<DataError>([&] { latest_checkpoint(run.root); }),
                    "ended before the first checkpoint or is complete");
    const std::string message = message_of<UsageError>([&] { prepare_run_folder(run, false); });
    EXPECT_CONTAINS(message, "--overwrite");
    EXPECT_EQ(message.find("--resume"), std::string::npos) << message;
}

TEST(RunFolder, FolderThatCannotBeMadeIsADataError) {
    const TempFolder folder;
    spit(folder / "plain", "x");
    EXPECT_CONTAINS(message_of<DataError>([&] { prepare_run_folder({folder / "plain"}, false); }), "plain");
    EXPECT_CONTAINS(message_of<DataError>([&] { prepare_run_folder({folder / "plain/run"}, false); }),
                    "Not a directory");
}

TEST(RunFolder, LatestIsTheHighestNumber) {
    const TempFolder folder;
    EXPECT_CONTAINS(message_of<DataError>([&] { latest_checkpoint(folder.path()); }), folder.path().string());
    EXPECT_THROW(latest_point_cloud(folder.path()), DataError);
    const RunFolder run{folder.path()};
    for (const int i : {900, 1000, 70}) spit(run.checkpoint(i), "x"), spit(run.point_cloud(i + 1), "x");
    spit(folder / "checkpoints/iteration_5000.safetensors.tmp", "x");
    EXPECT_EQ(latest_checkpoint(folder.path()), run.checkpoint(1000));
    EXPECT_EQ(latest_point_cloud(folder.path()), 1001);
}

TEST(RunFolder, CfgArgsIsThePythonNamespace) {
    const TempFolder folder;
    const RunFolder run{folder.path()};
    TrainOptions options;
    options.source = "/data/it's";
    options.images = "images_4";
    options.resolution = 4;
    options.eval = true;
    options.model_options["sh-degree"] = 2;
    options.background = Background::white();
    write_text_atomic(run.cfg_args(), cfg_args(run, options));
    EXPECT_EQ(slurp(run.cfg_args()),
              "Namespace(data_device='cuda', eval=True, images='images_4', model_path='" + folder.path().string() +
                  "', resolution=4, sh_degree=2, source_path='/data/it\\'s', white_background=True)");
    options.appearance = "none";
    options.source = "builtin:glossy";
    write_text_atomic(run.cfg_args(), cfg_args(run, options));
    EXPECT_CONTAINS(slurp(run.cfg_args()), "sh_degree=0, source_path='builtin:glossy'");
    options.source = "/data/caf\xE9";
    write_text_atomic(run.cfg_args(), cfg_args(run, options));
    EXPECT_CONTAINS(slurp(run.cfg_args()), "source_path='/data/caf\\udce9'");
}

TEST(RunFolder, InputPointsHaveTheLayoutOf3dgs) {
    const TempFolder folder;
    const RunFolder run{folder.path()};
    write_input_points(run, {{{1, 2, 3}}, {{0, 0, 0}}}, {{5e5, 4e6, 0}, 0.5});
    const std::string moved = slurp(run.input_points());
    EXPECT_NE(moved.find("comment gsapp offset 500000 4000000 0 "), std::string::npos);
    float x = 0;
    std::memcpy(&x, moved.data() + moved.find("end_header\n") + 11, 4);
    EXPECT_EQ(x, 2);
    write_input_points(run, {{{1, 2, 3}, {4, 5, 6}}, {{0, 0.5f, 1}, {1, 2, -1}}}, {});
    const std::string bytes = slurp(run.input_points());
    const std::size_t data = bytes.find("end_header\n") + 11;
    EXPECT_EQ(bytes.size(), data + 2 * 27);
    EXPECT_EQ(bytes.substr(data + 24, 3), std::string("\x00\x80\xff", 3));
    EXPECT_EQ(bytes.substr(data + 27 + 24, 3), std::string("\xff\xff\x00", 3));
    PlyReader file(run.input_points());
    ASSERT_EQ(file.next_chunk(), 2);
    EXPECT_EQ(file.value(1, file.require("y")), 5);
    EXPECT_EQ(file.value(1, file.require("nz")), 0);
}

TEST(CamerasJson, TestViewsFirstWithWorldFromCamera) {
    const TempFolder folder;
    Scene scene;
    View view;
    view.camera.width = 640, view.camera.height = 480;
    view.camera.fx = 500, view.camera.fy = 510;
    view.camera.rotation << 0, 1, 0, 0, 0, 1, 1, 0, 0;
    view.camera.translation = {1, 2, 3};
    view.name = "left/b.jpg";
    scene.train = {view};
    view.name = "a.jpg";
    scene.test = {view};
    write_cameras_json(folder / "cameras.json", scene);
    const auto json = parse_json(slurp(folder / "cameras.json"));
    ASSERT_EQ(json.size(), 2u);
    EXPECT_EQ(json[0]["img_name"], "a.jpg");
    EXPECT_EQ(json[1]["img_name"], "left/b.jpg");
    EXPECT_EQ(json[1]["id"], 1);
    EXPECT_EQ(json[0]["width"], 640);
    EXPECT_EQ(json[0]["height"], 480);
    EXPECT_EQ(json[0]["fx"], 500);
    EXPECT_EQ(json[0]["fy"], 510);
    // centre = -R^T t, rows of R^T
    EXPECT_EQ(json[0]["position"], (std::vector<double>{-3, -1, -2}));
    EXPECT_EQ(json[0]["rotation"], parse_json("[[0,0,1],[1,0,0],[0,1,0]]"));
    EXPECT_EQ(json[0]["cx"], 0);
    EXPECT_EQ(json[0]["cy"], 0);
    EXPECT_EQ(json[0]["split"], "test");
    EXPECT_EQ(json[1]["split"], "train");
    EXPECT_EQ(json[0].size(), 11u);
}

// One run at a time in a folder, and none in a folder that is gone.

TEST(RunLock, SecondRunIsRefusedAndTold) {
    const TempFolder folder;
    const fs::path run = folder / "a/run";
    {
        const RunLock lock(run);
        const std::string message = message_of<UsageError>([&] { RunLock second(run); });
        EXPECT_CONTAINS(message, run.string());
        EXPECT_CONTAINS(message, "(process " + std::to_string(::getpid()) + ")");
        lock.check_folder();
    }
    EXPECT_TRUE(fs::is_empty(run));
    const RunLock again(run);
}

TEST(RunLock, KilledRunLeavesNoLockBehind) {
    const TempFolder folder;
    int ready[2];
    ASSERT_EQ(::pipe(ready), 0);
    const pid_t child = ::fork();
    if (child == 0) {
        const RunLock lock(folder.path());
        if (::write(ready[1], "x", 1) != 1) ::_exit(1);
        ::pause();
        ::_exit(1);
    }
    char byte = 0;
    ASSERT_EQ(::read(ready[0], &byte, 1), 1);
    EXPECT_CONTAINS(message_of<UsageError>([&] { RunLock second(folder.path()); }),
                    "(process " + std::to_string(child) + ")");
    ::kill(child, SIGKILL);
    ASSERT_EQ(::waitpid(child, nullptr, 0), child);
    EXPECT_FALSE(fs::is_empty(folder.path())) << "the file stays";
    const RunLock lock(folder.path());
    ::close(ready[0]), ::close(ready[1]);
}

TEST(RunLock, NoticesThatTheFolderIsGone) {
    const TempFolder folder;
    const fs::path run = folder / "run", moved = folder / "moved";
    const RunLock lock(run);
    fs::rename(run, moved);
    EXPECT_CONTAINS(message_of<DataError>([&] { lock.check_folder(); }), run.string());
    fs::create_directory(run);
    EXPECT_CONTAINS(message_of<DataError>([&] { lock.check_folder(); }), "removed or replaced");
    fs::remove(run);
    fs::rename(moved, run);
    lock.check_folder();
}

TEST(RunLock, FolderThatCannotBeMadeIsADataError) {
    const TempFolder folder;
    spit(folder / "plain", "x");
    EXPECT_CONTAINS(message_of<DataError>([&] { RunLock lock(folder / "plain/run"); }), "plain/run");
    EXPECT_CONTAINS(message_of<DataError>([&] { RunLock lock(folder / "plain"); }), "plain");
}

}  // namespace
}  // namespace gs::test
