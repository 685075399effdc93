// SPDX-License-Identifier: Apache-2.0
// `prepare` with a stand-in for colmap on PATH: what it is asked to do, and what becomes of its failures.
#include "lib/scene/prepare.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <sstream>

#include "kernels/core/error.h"
#include "lib/core/process.h"
#include "lib/io/image.h"
#include "tests/core/temporary_folder.h"
#include "tests/io/tagged_image.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Writes what colmap would: two models (the second with more images), an undistorted scene, files nobody needs.
constexpr const char* kFakeColmap = R"(#!/bin/sh
echo "$QT_QPA_PLATFORM $*" >> "$COLMAP_CALLS"
command=$1
while [ $# -gt 0 ]; do
  case $1 in --output_path) output=$2;; --input_path) input=$2;; --image_path) images=$2;; esac
  shift
done
if [ "$command" = "$COLMAP_FAILS_AT" ]; then
  echo "all is well so far"
  echo "E1120 Something specific is broken" >&2
  exit 3
fi
case $command in
  feature_extractor)
    cp -rL "$images" "$COLMAP_CALLS.seen"
    echo "Processed file [1/2]"; echo "Processed file [2/2]";;
  mapper)
    [ -n "$COLMAP_FINDS_NOTHING" ] && exit 0
    mkdir -p "$output/0" "$output/1"
    printf '\002\000\000\000\000\000\000\000' > "$output/0/images.bin"
    printf '\005\000\000\000\000\000\000\000' > "$output/1/images.bin";;
  image_undistorter)
    mkdir -p "$output/images" "$output/sparse" "$output/stereo"
    echo "$input" > "$output/sparse/cameras.bin"
    touch "$output/sparse/images.bin" "$output/images/a.png" "$output/run-colmap-geometric.sh";;
esac
)";

class Prepare : public ::testing::Test {
  protected:
    void SetUp() override {
        const fs::path program = folder_.write("colmap", kFakeColmap);
        fs::permissions(program, fs::perms::owner_all);
        path_before_ = std::getenv("PATH");
        ::setenv("PATH", (folder_.path().string() + ":" + path_before_).c_str(), 1);
        ::setenv("COLMAP_CALLS", (folder_.path() / "calls").c_str(), 1);
        fs::create_directories(photographs() / "sub");
        fs::create_directories(parent());
        write_image(photographs() / "a.png", picture(8, 6));
        write_image(photographs() / "sub" / "b.png", picture(8, 6));
        folder_.write("photographs/notes.txt", "not a photograph");
        options_.images = photographs();
        options_.scene = parent() / "scene";
    }
    void TearDown() override {
        ::setenv("PATH", path_before_.c_str(), 1);
        for (const char* name : {"COLMAP_CALLS", "COLMAP_FAILS_AT", "COLMAP_FINDS_NOTHING"}) ::unsetenv(name);
    }

    fs::path photographs() const { return folder_.path() / "photographs"; }
    fs::path parent() const { return folder_.path() / "scenes"; }
    static Image picture(int width, int height) {
        Image image{width, height, 3, {}, {}};
        image.u8.assign(std::size_t(width) * height * 3, 100);
        return image;
    }
    static std::string text_of(const fs::path& path) {
        std::stringstream text;
        text << std::ifstream(path).rdbuf();
        return text.str();
    }
    std::string calls() const { return text_of(folder_.path() / "calls"); }
    bool nothing_left() const { return fs::is_empty(parent()); }
    void prepare() {
        prepare_scene(options_, [this](int stage, int stages, const std::string& name, const std::string& count) {
            shown_ += std::to_string(stage) + "/" + std::to_string(stages) + " " + name + " " + count + "\n";
        });
    }
    std::string failure() {
        try {
            prepare();
        } catch (const Error& e) {
            return e.what();
        }
        return "";
    }

    test::TemporaryFolder folder_;
    PrepareOptions options_;
    std::string path_before_, shown_;
};

TEST_F(Prepare, MakesASceneFromFourStages) {
    options_.matcher = "sequential";
    options_.camera_model = "SIMPLE_RADIAL";
    prepare();
    EXPECT_TRUE(fs::exists(options_.scene / "images" / "a.png"));
    EXPECT_TRUE(fs::exists(options_.scene / "sparse" / "0" / "images.bin"));
    EXPECT_NE(text_of(options_.scene / "sparse" / "0" / "cameras.bin").find("/models/1"), std::string::npos)
        << "the model with more images";
    EXPECT_EQ(std::distance(fs::directory_iterator(options_.scene), fs::directory_iterator()), 2)
        << "images and sparse only";
    EXPECT_EQ(std::distance(fs::directory_iterator(parent()), fs::directory_iterator()), 1)
        << "no temporary folder left";
    const std::string said = calls();
    EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 4);
    EXPECT_EQ(said.find("offscreen feature_extractor"), 0u);
    EXPECT_NE(
        said.find("--ImageReader.camera_model SIMPLE_RADIAL --ImageReader.single_camera 1 --SiftExtraction.use_gpu 0"),
        std::string::npos);
    EXPECT_NE(said.find("offscreen sequential_matcher"), std::string::npos);
    EXPECT_NE(said.find("--output_type COLMAP"), std::string::npos);
    EXPECT_EQ(shown_,
              "1/4 features \n1/4 features 1/2\n1/4 features 2/2\n2/4 matches \n3/4 cameras \n4/4 undistortion \n");
}

TEST_F(Prepare, PhotographsOfDifferentSizesGetTheirOwnCameras) {
    write_image(photographs() / "portrait.png", picture(6, 8));
    options_.gpu = true;
    prepare();
    EXPECT_NE(calls().find("single_camera 0 --SiftExtraction.use_gpu 1"), std::string::npos);
}

TEST_F(Prepare, FailuresCarryColmapsWordsAndLeaveNothing) {
    for (const char* stage : {"feature_extractor", "exhaustive_matcher", "mapper", "image_undistorter"}) {
        ::setenv("COLMAP_FAILS_AT", stage, 1);
        const std::string message = failure();
        EXPECT_NE(message.find(std::string("colmap ") + stage + " ended with exit code 3"), std::string::npos)
            << message;
        EXPECT_NE(message.find("Something specific is broken"), std::string::npos);
        EXPECT_TRUE(nothing_left()) << stage;
    }
    ::unsetenv("COLMAP_FAILS_AT");
    ::setenv("COLMAP_FINDS_NOTHING", "1", 1);
    EXPECT_NE(failure().find("no camera positions"), std::string::npos);
    EXPECT_TRUE(nothing_left());
}

TEST_F(Prepare, WithoutColmapItSaysHowToGetIt) {
    fs::remove(folder_.path() / "colmap");
    ::setenv("PATH", folder_.path().c_str(), 1);
    EXPECT_NE(failure().find("apt-get install colmap"), std::string::npos);
    EXPECT_TRUE(nothing_left());
}

TEST_F(Prepare, ExistingFoldersAreProtected) {
    prepare();
    EXPECT_NE(failure().find("--overwrite"), std::string::npos);
    options_.overwrite = true;
    EXPECT_EQ(failure(), "");
    EXPECT_TRUE(fs::exists(options_.scene / "sparse" / "0"));
    // Not a scene: never replaced.
    fs::create_directories(parent() / "other" / "precious");
    options_.scene = parent() / "other";
    EXPECT_NE(failure().find("is not a scene"), std::string::npos);
    EXPECT_TRUE(fs::exists(parent() / "other" / "precious"));
    // The photographs are inside the target, or the target inside the photographs.
    fs::create_directories(folder_.path() / "sparse");
    options_.scene = folder_.path();
    EXPECT_NE(failure().find("holds the photographs"), std::string::npos);
    options_.scene = photographs() / "scene";
    EXPECT_NE(failure().find("inside the folder of photographs"), std::string::npos);
}

TEST_F(Prepare, AFolderWithoutPhotographsIsADataError) {
    options_.images = folder_.path() / "empty";
    fs::create_directories(options_.images);
    EXPECT_THROW(prepare(), DataError);
    options_.images = folder_.path() / "missing";
    EXPECT_THROW(prepare(), DataError);
    EXPECT_TRUE(nothing_left());
}

TEST(Process, TellsExitCodesSignalsAndLastLines) {
    std::vector<std::string> lines;
    const auto run = [&](const std::string& script) {
        return run_process({"sh", "-c", script}, {{"GREETING", "hello"}},
                           [&](const std::string& l) { lines.push_back(l); });
    };
    EXPECT_EQ(run("echo $GREETING; printf '1\\r2\\nlast'; exit 4").exit_code, 4);
    EXPECT_EQ(lines, (std::vector<std::string>{"hello", "1", "2", "last"}));
    EXPECT_EQ(run("kill -9 $$").exit_code, 137);
    const auto many = run("i=0; while [ $i -lt 50 ]; do echo line $i; i=$((i+1)); done");
    EXPECT_EQ(many.last_lines.size(), 12u);
    EXPECT_EQ(many.last_lines.back(), "line 49");
    EXPECT_THROW(run_process({"gsapp-no-such-program"}, {}, [](const std::string&) {}), UsageError);
    EXPECT_THROW(run_process({"sh", "-c", "yes"}, {}, [](const std::string&) { throw DataError("stop"); }), DataError)
        << "must not wait for ever";
}

TEST_F(Prepare, PhotographsThatLieOnTheirSideAreTurnedBeforeColmapSeesThem) {
    test::write_tagged(photographs() / "sub" / "turned.jpg", 6, 8, 6);
    prepare();
    const fs::path seen = folder_.path() / "calls.seen";
    const ImageInfo turned = read_image_info(seen / "sub" / "turned.jpg");
    EXPECT_EQ(turned.width, 8);
    EXPECT_EQ(turned.height, 6);
    EXPECT_EQ(turned.orientation, 1);
    EXPECT_EQ(text_of(seen / "a.png"), text_of(photographs() / "a.png"));
    EXPECT_EQ(text_of(seen / "sub" / "b.png"), text_of(photographs() / "sub" / "b.png"));
    EXPECT_EQ(read_image_info(photographs() / "sub" / "turned.jpg").orientation, 6) << "the original stays";
    const std::string said = calls();
    EXPECT_NE(said.find("--ImageReader.single_camera 1"), std::string::npos) << "all have one size once upright";
    EXPECT_EQ(said.find("--image_path " + photographs().string()), std::string::npos) << "no stage sees the original";
    EXPECT_EQ(std::distance(fs::directory_iterator(parent()), fs::directory_iterator()), 1) << "no copies left";
}

TEST_F(Prepare, SideFilesWithAnOrientationAreNoPhotographs) {
    test::write_tagged(photographs() / "turned.jpg", 6, 8, 6);
    fs::copy_file(photographs() / "turned.jpg", photographs() / "turned.jpg_original");
    test::write_tagged(photographs() / "raw.tif", 6, 4, 6);
    fs::rename(photographs() / "raw.tif", photographs() / "raw.NEF");
    EXPECT_EQ(failure(), "");
    const fs::path seen = folder_.path() / "calls.seen";
    EXPECT_EQ(read_image_info(seen / "turned.jpg").orientation, 1);
    for (const char* name : {"turned.jpg_original", "raw.NEF"})
        EXPECT_EQ(text_of(seen / name), text_of(photographs() / name)) << name;
    EXPECT_NE(calls().find("--ImageReader.single_camera 1"), std::string::npos) << "their sizes do not count";
}

TEST_F(Prepare, UprightAndLevelPhotographsOfOneDeviceStillShareOneCamera) {
    test::write_tagged(photographs() / "turned.jpg", 8, 6, 6);
    prepare();
    EXPECT_EQ(read_image_info(folder_.path() / "calls.seen" / "turned.jpg").width, 8) << "as stored";
    EXPECT_NE(calls().find("--ImageReader.single_camera 1"), std::string::npos);
}

}  // namespace
}  // namespace gs
