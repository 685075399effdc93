// SPDX-License-Identifier: Apache-2.0
// gsapp render on a run of the program: which folders it fills, videos, and what it refuses.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "lib/io/image.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using test::Outcome;
using test::Program;

/// A folder with a small run, 40x30 pixels.
class RenderCommand : public testing::Test {
  protected:
    void SetUp() override {
        program.train("run", "-s builtin:glossy --eval --appearance none --iterations 2 --init-points 300 -r 4");
    }

    Outcome expect_ok(const std::string& arguments, const std::string& before = "") const {
        const Outcome outcome = program.run("render run " + arguments, before);
        EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.err;
        EXPECT_EQ(outcome.out, "");
        return outcome;
    }
    void expect_refused(const std::string& arguments, int exit_code, const std::string& reason,
                        const std::string& before = "") const {
        const Outcome outcome = program.run("render run " + arguments, before);
        EXPECT_EQ(outcome.exit_code, exit_code) << arguments << "\n" << outcome.err;
        EXPECT_NE(outcome.err.find(reason), std::string::npos) << arguments << "\n" << outcome.err;
    }
    /// The number of files in a folder, hidden ones and those below included; -1 without the folder.
    int files(const std::string& folder) const {
        if (!fs::exists(program.path(folder))) return -1;
        int count = 0;
        for (const auto& entry : fs::recursive_directory_iterator(program.path(folder))) count += !entry.is_directory();
        return count;
    }
    /// Puts a program in place of ffmpeg. It answers to -version; the rest is `script`.
    std::string fake_ffmpeg(const std::string& script) const {
        fs::create_directories(program.path("bin"));
        const fs::path path =
            program.folder().write("bin/ffmpeg", "#!/bin/sh\n[ \"$1\" = -version ] && exit 0\n" + script);
        ::chmod(path.c_str(), 0755);
        return "PATH=\"$PWD/bin:$PATH\"";
    }

    Program program;
};

TEST_F(RenderCommand, EveryKindOfCamerasHasItsFolder) {
    expect_ok("");
    EXPECT_EQ(files("run/renders"), 8);
    EXPECT_EQ(files("run/renders/iteration_2/test"), 8);
    expect_ok("--orbit 3");
    expect_ok("--path run/cameras.json");
    EXPECT_EQ(files("run/renders/iteration_2/orbit"), 3);
    EXPECT_EQ(files("run/renders/iteration_2/path"), 48);
    EXPECT_EQ(files("run/renders/iteration_2/train"), -1);
    expect_ok("--views all");
    EXPECT_EQ(files("run/renders/iteration_2/train"), 40);
    EXPECT_EQ(files("run/renders"), 8 + 3 + 48 + 40);

    expect_ok("-o 'my pictures/of it'");
    EXPECT_EQ(files("my pictures/of it"), 8);
    const Outcome as_3dgs = program.run("render -m run -o named");  // as its render.py
    EXPECT_EQ(as_3dgs.exit_code, 0) << as_3dgs.err;
    EXPECT_EQ(files("named"), 8);
    expect_ok("-o both/ --views all");
    EXPECT_EQ(files("both/test"), 8);
    EXPECT_EQ(files("both/train"), 40);
    EXPECT_EQ(program.read("both/test/00003.png"), program.read("my pictures/of it/00003.png"));
    // cameras.json has the test views first.
    EXPECT_EQ(program.read("run/renders/iteration_2/path/00003.png"), program.read("both/test/00003.png"));
    EXPECT_EQ(program.read("run/renders/iteration_2/path/00010.png"), program.read("both/train/00002.png"));
}

TEST_F(RenderCommand, TellsProgramsWhereThePicturesAre) {
    const Outcome outcome = program.run("render run --views all -o told --json --quiet");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    const nlohmann::json written = parse_json(outcome.out);
    ASSERT_EQ(written["folders"].size(), 2u) << outcome.out;
    EXPECT_EQ(written["folders"][0], parse_json(R"({"folder": "told/test", "pictures": 8})"));
    EXPECT_EQ(written["folders"][1], parse_json(R"({"folder": "told/train", "pictures": 40})"));
    EXPECT_TRUE(written["video"].is_null());
}

TEST_F(RenderCommand, FramesOfTwoCallsAreNeverMixed) {
    expect_ok("--orbit 5");
    const std::string first = program.read("run/renders/iteration_2/orbit/00001.png");
    expect_refused("--orbit 3", 2, "--overwrite");
    EXPECT_EQ(files("run/renders"), 5);
    EXPECT_EQ(program.read("run/renders/iteration_2/orbit/00001.png"), first);
    expect_ok("--orbit 3 --overwrite");
    EXPECT_EQ(files("run/renders"), 3);
    EXPECT_NE(program.read("run/renders/iteration_2/orbit/00001.png"), first) << "a third of a turn, not a fifth";
    expect_ok("--orbit 4");  // replaces all that was there
    EXPECT_EQ(files("run/renders"), 4);
    expect_ok("--orbit 4 --depth --median-depth --normals --alpha");
    EXPECT_EQ(files("run/renders"), 4 + 4 * 8 + 2);
    expect_refused("--orbit 4", 2, "alpha/00000.exr");
    expect_ok("--orbit 4 --overwrite");
    EXPECT_EQ(files("run/renders"), 4);
    // The second folder is refused before anything is written to the first.
    expect_ok("--orbit 41 -o both/train");
    expect_refused("--views all -o both", 2, "both/train");
    EXPECT_EQ(files("both"), 41);
}

TEST_F(RenderCommand, MedianDepthHasAFolderOfItsOwn) {
    expect_ok("--orbit 2 --median-depth --alpha -o out");
    EXPECT_EQ(files("out/median_depth"), 2 * 2 + 1);
    EXPECT_EQ(files("out/depth"), -1) << "nobody asked for the expected one";
    const auto range = parse_json(program.read("out/median_depth/range.json"));
    EXPECT_NE(range["values"].get<std::string>().find("median"), std::string::npos);
    EXPECT_GT(range["far"], range["near"]);
    const Image depth = read_image(program.path("out/median_depth/00001.exr")),
                alpha = read_image(program.path("out/alpha/00001.exr"));
    int covered = 0;
    for (int y = 0; y < depth.height; ++y)
        for (int x = 0; x < depth.width; ++x) {
            ASSERT_EQ(depth.value(x, y, 0) > 0, alpha.value(x, y, 0) >= 0.5f) << x << "," << y;
            covered += depth.value(x, y, 0) > 0;
        }
    EXPECT_GT(covered, 50);
}

TEST_F(RenderCommand, WhatIsStoppedLeavesNothing) {
    expect_ok("--orbit 2");
    const Outcome outcome =
        program.interrupt("render run --orbit 100000 --size 400x300 --overwrite --depth", "field of view");
    EXPECT_EQ(outcome.exit_code, 130) << outcome.err;
    EXPECT_EQ(files("run/renders"), 2) << "the earlier pictures, and no others";
}

TEST_F(RenderCommand, SizesAndOrbits) {
    const Outcome outcome = expect_ok("--orbit 2 --size 96x30 -o wide");
    EXPECT_NE(outcome.err.find("vertical field of view"), std::string::npos) << outcome.err;
    expect_ok("--orbit 2 -o usual");
    const Image wide = read_image(program.path("wide/00001.png")), usual = read_image(program.path("usual/00001.png"));
    ASSERT_EQ(wide.width, 96);
    ASSERT_EQ(wide.height, 30);
    int different = 0;  // the middle shows the same
    for (int y = 0; y < 30; ++y)
        for (int x = 0; x < 40; ++x) different += std::abs(wide.value(x + 28, y, 1) - usual.value(x, y, 1)) > 0.02f;
    EXPECT_LT(different, 12);

    expect_ok("--orbit 1 --orbit-radius 0.8x --orbit-elevation -10.5 --orbit-target=-0.1,0,0.3 -o other");
    expect_ok("--orbit 1 --orbit-radius 3 -o units");
    EXPECT_NE(program.read("other/00000.png"), program.read("usual/00000.png"));
    expect_ok("--orbit 1 --size 1x1 --depth --normals --alpha --decompose -o tiny");
    EXPECT_EQ(files("tiny"), 3 + 6 + 1);

    for (const char* wrong :
         {"--orbit 0", "--orbit 2 --orbit-radius 0", "--orbit 2 --orbit-radius nan", "--orbit 2 --orbit-elevation 90",
          "--orbit 2 --orbit-elevation nan", "--orbit 2 --orbit-target 1,2", "--orbit 2 --size 9999999x1",
          "--orbit 2 --size 0x5", "--size 8192x4097", "--orbit-radius 2", "--orbit 2 --views test", "--fps 20",
          "--orbit 2 --video a.mp4 --fps 0", "--show appearance --decompose"})
        expect_refused(wrong, 2, "--");
    EXPECT_EQ(files("run/renders"), -1);
}

TEST_F(RenderCommand, PathsOfNerfstudioAreRendered) {
    program.folder().write(
        "camera_path.json",
        R"({"camera_type":"perspective","render_width":33,"render_height":21,"fps":8,"camera_path":[)"
        R"({"camera_to_world":[1,0,0,0,0,0,-1,-4,0,1,0,0.5,0,0,0,1],"fov":50,"aspect":1.57},)"
        R"({"camera_to_world":[1,0,0,0,0,0,-1,-3,0,1,0,0.5,0,0,0,1],"fov":50,"aspect":1.57}]})");
    const std::string path = fake_ffmpeg("echo \"$@\" >words\nfor last; do :; done\necho video >\"$last\"\n");
    expect_ok("--path camera_path.json --video video.mp4", path);
    EXPECT_EQ(files("run/renders/iteration_2/path"), 2);
    EXPECT_EQ(read_image(program.path("run/renders/iteration_2/path/00001.png")).width, 33);
    EXPECT_NE(program.read("words").find("-framerate 8 "), std::string::npos) << "what the file says";
    expect_ok("--path camera_path.json --video video.mp4 --fps 12.5", path);
    EXPECT_NE(program.read("words").find("-framerate 12.5 "), std::string::npos) << program.read("words");
    program.folder().write("bad.json", R"({"render_width":33,"render_height":21,"camera_path":[{"fov":50}]})");
    expect_refused("--path bad.json", 3, "bad.json: camera_path entry 0: 'camera_to_world' is missing");
    EXPECT_EQ(files("run/renders"), 2);
}

TEST_F(RenderCommand, VideosAreMadeByFfmpegOfThePictures) {
    const std::string good = fake_ffmpeg("echo \"$@\" >words\nfor last; do :; done\necho video >\"$last\"\n");
    expect_ok("--orbit 3 --video 'my video.mp4'", good);
    EXPECT_EQ(program.read("my video.mp4"), "video\n");
    const std::string words = program.read("words");
    for (const char* part : {"-framerate 30 ", "run/renders/iteration_2/orbit/%05d.png", "-frames:v 3 ", "libx264",
                             "yuv420p", "trunc(iw/2)*2"})
        EXPECT_NE(words.find(part), std::string::npos) << part << " in " << words;
    expect_ok("--orbit 3 --decompose -o '50%d/x' --video video.webm", good);
    EXPECT_NE(program.read("words").find("50%%d/x/full/%05d.png"), std::string::npos) << program.read("words");
    EXPECT_NE(program.read("words").find("libvpx-vp9"), std::string::npos);

    const std::string bad =
        fake_ffmpeg("echo 'Unknown encoder' >&2\nfor last; do :; done\necho half >\"$last\"\nexit 7\n");
    expect_refused("--orbit 3 --video 'my video.mp4'", 3, "exit code 7:\nUnknown encoder", bad);
    EXPECT_EQ(program.read("my video.mp4"), "video\n") << "the earlier video stays";
    EXPECT_EQ(files("run/renders"), 3) << "and the pictures";
    expect_refused("--orbit 3 --video new.mp4", 3, "ffmpeg ended with exit code 0", fake_ffmpeg("exit 0\n"));
    for (const auto& entry : fs::directory_iterator(program.folder().path()))
        EXPECT_NE(entry.path().extension(), ".tmp") << entry.path();
    EXPECT_FALSE(fs::exists(program.path("new.mp4")));

    fs::remove_all(program.path("run/renders"));
    expect_refused("--orbit 3 --video video.mp4", 2, "apt install ffmpeg", "PATH=/nonexistent");
    expect_refused("--orbit 3 --video video.avi", 2, ".mp4", good);
    expect_refused("--orbit 3 --size 40x1 --video video.mp4", 2, "at least 2x2", good);
    expect_refused("--views all --video video.mp4", 2, "--views test", good);
    program.folder().write("sizes.json",
                           R"([{"width":8,"height":6,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5},)"
                           R"({"width":8,"height":8,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5}])");
    EXPECT_EQ(files("run/renders"), -1) << "all of this is said before anything is rendered";
    fake_ffmpeg("for last; do :; done\necho video >\"$last\"\n");
    expect_ok("--path sizes.json --size 8x6 --video sizes.mp4", good);
}

TEST_F(RenderCommand, VideosOfViewsThatDifferInSizeHaveTheMostFrequentOne) {
    const std::string ffmpeg = fake_ffmpeg("for last; do :; done\necho video >\"$last\"\n");
    const auto camera = [](int width, int height) {
        return R"({"width":)" + std::to_string(width) + R"(,"height":)" + std::to_string(height) +
               R"(,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5})";
    };
    program.folder().write("sizes.json",
                           "[" + camera(12, 9) + "," + camera(11, 9) + "," + camera(12, 8) + "," + camera(11, 9) + "]");
    const Outcome outcome = expect_ok("--path sizes.json -o pictures --video video.mp4", ffmpeg);
    EXPECT_NE(outcome.err.find("the views have 3 sizes"), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("10x8"), std::string::npos) << outcome.err;
    for (int i = 0; i < 4; ++i) {
        const Image picture = read_image(program.path("pictures/0000" + std::to_string(i) + ".png"));
        EXPECT_EQ(picture.width, 10);
        EXPECT_EQ(picture.height, 8);
    }
    EXPECT_EQ(expect_ok("--path sizes.json -o others").err.find("sizes"), std::string::npos) << "without a video";
    EXPECT_EQ(read_image(program.path("others/00000.png")).width, 12);
}

TEST_F(RenderCommand, PathsOfTransformsJsonAreRendered) {
    program.folder().write("transforms.json",
                           R"({"camera_model":"OPENCV","fl_x":20,"w":31,"h":17,"k1":0.1,"frames":[{"file_path":"a",)"
                           R"("transform_matrix":[[1,0,0,0],[0,0,-1,-4],[0,1,0,0.5],[0,0,0,1]]}]})");
    expect_ok("--path transforms.json -o path");
    const Image bent = read_image(program.path("path/00000.png"));
    EXPECT_EQ(bent.width, 31);
    std::string straight = program.read("transforms.json");
    straight.replace(straight.find("\"k1\":0.1"), 8, "\"k1\":0.0");
    program.folder().write("straight.json", straight);
    expect_ok("--path straight.json -o straight");
    EXPECT_TRUE(bent.u8 != read_image(program.path("straight/00000.png")).u8) << "rendered through its lens";
    program.folder().write("nowhere.json", R"({"camera_angle_x":0.7,"frames":[{"file_path":"a",)"
                                           R"("transform_matrix":[[1,0,0,0],[0,0,-1,-4],[0,1,0,0.5],[0,0,0,1]]}]})");
    expect_refused("--path nowhere.json -o other", 3, "'w' and 'h'");
}

TEST_F(RenderCommand, TakesTheWordsOf3dgs) {
    expect_ok("--quiet --skip_train --eval --iteration 2 -r 4 -o test");
    expect_ok("--skip_test --iteration -1 -o train");
    EXPECT_GT(files("train"), files("test"));
    expect_ok("--views test -o views");
    EXPECT_EQ(files("views"), files("test"));
    expect_refused("--skip_train --skip_test -o x", 2, "--skip_t");
    expect_refused("--skip_train -r 8 -o x", 2, "--resolution: goes with a .ply file");
    expect_refused("--iteration 7000 -o x", 3, "--save-iterations 7000");
}

TEST_F(RenderCommand, VideosPlay) {
    if (std::system("ffmpeg -v error -f lavfi -i color=s=16x16:d=0.1 -c:v libx264 -f null - >/dev/null 2>&1") != 0)
        GTEST_SKIP() << "there is no ffmpeg with libx264";
    expect_ok("--orbit 4 --size 321x181 -o pictures --video video.mp4 --fps 10");
    const std::string video = program.path("video.mp4").string();
    fs::create_directory(program.path("back"));
    const std::string decode = "ffmpeg -v error -i '" + video + "' '" + program.path("back").string() + "/%05d.png'";
    ASSERT_EQ(std::system(decode.c_str()), 0);
    EXPECT_EQ(files("back"), 4);
    for (int i = 0; i < 4; ++i) {
        const Image shown = read_image(program.path("back/0000" + std::to_string(i + 1) + ".png"));
        const Image picture = read_image(program.path("pictures/0000" + std::to_string(i) + ".png"));
        ASSERT_EQ(shown.width, 320) << "an even size";
        ASSERT_EQ(shown.height, 180);
        double error = 0;
        for (int y = 0; y < 180; ++y)
            for (int x = 0; x < 320; ++x)
                for (int c = 0; c < 3; ++c) error += std::abs(shown.value(x, y, c) - picture.value(x, y, c));
        EXPECT_LT(error / (320 * 180 * 3), 0.01) << "picture " << i;
    }
    if (std::system("ffmpeg -v error -f lavfi -i color=s=16x16:d=0.1 -c:v libvpx-vp9 -f null - >/dev/null 2>&1") == 0)
        expect_ok("--orbit 4 -o pictures --video video.webm");
}

TEST_F(RenderCommand, HoldsAtMostThirtyBytesForAPixelWhateverIsRendered) {
#ifdef __SANITIZE_ADDRESS__
    GTEST_SKIP() << "freed memory is kept";
#endif
    program.folder().write("path.json", R"([{"width": 4096, "height": 2048, "fx": 2048, "fy": 2048,
        "position": [0, 0, -4], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}])");
    expect_ok("--path path.json --depth --normals --alpha --decompose -o parts");
    rusage use{};
    getrusage(RUSAGE_CHILDREN, &use);
    const double pixels = 4096.0 * 2048, program_itself = 180 * 1048576.0;
    EXPECT_LT(1024.0 * double(use.ru_maxrss), program_itself + 30 * pixels) << "a 150-byte file must not take 2 GiB";
}

}  // namespace
}  // namespace gs
