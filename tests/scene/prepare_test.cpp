// SPDX-License-Identifier: Apache-2.0
// `prepare` with a stand-in for colmap on PATH: what it is asked to do, and what becomes of its failures.
#include "lib/scene/prepare.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <sstream>

#include "kernels/base/error.h"
#include "lib/core/process.h"
#include "lib/io/image.h"
#include "lib/scene/matching.h"
#include "lib/scene/photographs.h"
#include "lib/scene/programs.h"
#include "tests/core/temporary_folder.h"
#include "tests/io/tagged_image.h"
#include "tests/scene/fake_programs.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

class Prepare : public ::testing::Test {
  protected:
    void SetUp() override {
        install("colmap", test::kFakeColmap);
        path_before_ = std::getenv("PATH");
        home_before_ = std::getenv("HOME") ? std::getenv("HOME") : "";
        ::setenv("HOME", folder_.path().c_str(), 1);
        ::setenv("COLMAP_MODEL", (folder_.path() / "model").c_str(), 1);
        ::setenv("PATH", (folder_.path().string() + ":" + path_before_).c_str(), 1);
        ::setenv("COLMAP_CALLS", (folder_.path() / "calls").c_str(), 1);
        fs::create_directories(photographs() / "sub");
        fs::create_directories(parent());
        write_image(photographs() / "a.png", picture(8, 6));
        write_image(photographs() / "sub" / "b.png", picture(8, 6));
        folder_.write("photographs/notes.txt", "not a photograph");
        register_photographs({"a.png", "sub/b.png"});
        options_.source = photographs();
        options_.scene = parent() / "scene";
    }
    void TearDown() override {
        ::setenv("PATH", path_before_.c_str(), 1);
        ::setenv("HOME", home_before_.c_str(), 1);
        for (const char* name : {"COLMAP_CALLS", "COLMAP_FAILS_AT", "COLMAP_FINDS_NOTHING", "COLMAP_MODEL",
                                 "COLMAP_STYLE", "FFMPEG_FRAMES", "FFMPEG_FAILS"})
            ::unsetenv(name);
    }

    void install(const std::string& name, const char* script) {
        fs::permissions(folder_.write(name, script), fs::perms::owner_all);
    }
    /// Has colmap register these, and find four points.
    void register_photographs(const std::vector<std::string>& names) {
        test::write_model(folder_.path() / "model", {test::TestCamera{}}, test::row_of_images(names),
                          {{1}, {2}, {3}, {4}});
    }
    /// Writes photographs as PREFIX0001.png and so on. They are links to one.
    std::vector<std::string> number_photographs(const std::string& prefix, int count) {
        std::vector<std::string> names;
        for (int i = 0; i < count; ++i) {
            names.push_back(fmt::format("{}{:04}.png", prefix, i));
            fs::create_hard_link(photographs() / "a.png", photographs() / names.back());
        }
        return names;
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
    bool only_the_log_is_left() const {
        const auto count = [](const fs::path& folder) {
            return std::distance(fs::directory_iterator(folder), fs::directory_iterator());
        };
        return count(parent()) == 1 && count(options_.scene) == 1 && fs::exists(options_.scene / "colmap-failed.log");
    }
    PrepareReport prepare() {
        return prepare_scene(
            options_, [this](int stage, int stages, const std::string& name, const std::string& count) {
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
    std::string path_before_, home_before_, shown_;
};

TEST_F(Prepare, PhotographsOf360DegreesAreKept) {
    for (const char* name : {"a.png", "sub/b.png", "c.png"}) write_image(photographs() / name, picture(64, 32));
    register_photographs({"a.png/face1.jpg", "a.png/face2.jpg", "sub/b.png/face0.jpg"});
    options_.camera_model = "EQUIRECTANGULAR";
    const PrepareReport report = prepare();
    EXPECT_EQ(report.registered, 2u);
    EXPECT_EQ(report.photographs, 3u);
    EXPECT_EQ(report.points, 4u);
    EXPECT_EQ(report.left_out, std::vector<std::string>{"c.png"});
    ASSERT_EQ(report.notes.size(), 2u);
    EXPECT_CONTAINS(report.notes[0], "the faces of a 360-degree photograph differ by ");
    EXPECT_EQ(report.notes[1],
              "faces that differ from the others by more than 5 degrees were left out; check the cameras of a.png");
    EXPECT_EQ(text_of(options_.scene / "images/sub/b.png"), text_of(photographs() / "sub/b.png")) << "as it was";
    EXPECT_FALSE(fs::exists(options_.scene / "images/c.png")) << "without a camera";
    EXPECT_EQ(std::distance(fs::directory_iterator(options_.scene), fs::directory_iterator()), 3);
    EXPECT_CONTAINS(text_of(options_.scene / "sparse/0/cameras.txt"), "1 EQUIRECTANGULAR 64 32 64 32\n");
    for (const char* asked : {"--ImageReader.camera_model SIMPLE_PINHOLE --ImageReader.single_camera 1 "
                              "--ImageReader.camera_params 10,10,10",
                              "--Mapper.ba_refine_focal_length 0"})
        EXPECT_CONTAINS(calls(), asked);
    EXPECT_EQ(calls().find("image_undistorter"), std::string::npos);
    EXPECT_EQ(shown_,
              "1/4 faces \n1/4 faces 1/3\n1/4 faces 2/3\n1/4 faces 3/3\n2/4 features \n2/4 features 1/2\n2/4 features "
              "2/2\n3/4 matching \n3/4 "
              "matching 4/9\n4/4 registered \n4/4 registered 2/18\n");
}

TEST_F(Prepare, SequencesOf360DegreesCompareTheFacesOfTenNeighbours) {
    for (const char* name : {"a.png", "sub/b.png"}) write_image(photographs() / name, picture(64, 32));
    register_photographs({"a.png/face1.jpg", "a.png/face2.jpg"});
    options_.camera_model = "EQUIRECTANGULAR";
    options_.matching = "sequential";
    prepare();
    EXPECT_CONTAINS(calls(), "--SequentialMatching.overlap 60 --SequentialMatching.quadratic_overlap 0");
    options_.matching = "auto";
    ColmapProgram colmap;
    fs::remove_all(photographs());
    fs::create_directories(photographs());
    write_image(photographs() / "a.png", picture(64, 32));
    EXPECT_EQ(choose_matching(options_, number_photographs("p", 50), false, colmap).command, "exhaustive_matcher");
    EXPECT_EQ(choose_matching(options_, number_photographs("q", 51), false, colmap).command, "sequential_matcher");
}

TEST_F(Prepare, MakesASceneFromFourStages) {
    options_.matching = "sequential";
    options_.camera_model = "SIMPLE_RADIAL";
    const PrepareReport report = prepare();
    EXPECT_TRUE(fs::exists(options_.scene / "images" / "a.png"));
    EXPECT_TRUE(fs::exists(options_.scene / "sparse" / "0" / "images.bin"));
    EXPECT_EQ(report.registered, 2u) << "of the model with more images";
    EXPECT_EQ(report.other_models, std::vector<std::size_t>{1});
    EXPECT_EQ(std::distance(fs::directory_iterator(options_.scene), fs::directory_iterator()), 3)
        << "images, sparse and the log only";
    EXPECT_EQ(report.log, options_.scene / "colmap.log");
    const std::string log = text_of(report.log);
    for (const char* part : {"$ colmap feature_extractor --database_path ", "\nProcessed file [2/2]\n$ colmap seq"})
        EXPECT_NE(log.find(part), std::string::npos) << log;
    EXPECT_EQ(std::distance(fs::directory_iterator(parent()), fs::directory_iterator()), 1)
        << "no temporary folder left";
    const std::string said = calls();
    EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 5);
    EXPECT_EQ(said.find("offscreen feature_extractor"), 0u);
    EXPECT_NE(
        said.find("--ImageReader.camera_model SIMPLE_RADIAL --ImageReader.single_camera 1 --SiftExtraction.use_gpu 0"),
        std::string::npos);
    EXPECT_NE(said.find("offscreen sequential_matcher"), std::string::npos);
    EXPECT_NE(said.find("--output_type COLMAP"), std::string::npos);
    EXPECT_EQ(shown_,
              "1/4 features \n1/4 features 1/2\n1/4 features 2/2\n2/4 matching \n3/4 registered \n3/4 registered "
              "2/2\n4/4 undistorted \n");
}

TEST_F(Prepare, PhotographsOfDifferentSizesGetTheirOwnCameras) {
    write_image(photographs() / "portrait.png", picture(6, 8));
    prepare();
    EXPECT_NE(calls().find("single_camera 0 --SiftExtraction.use_gpu 0"), std::string::npos);
}

TEST_F(Prepare, FailuresCarryColmapsWordsAndLeaveNothing) {
    for (const char* stage : {"feature_extractor", "exhaustive_matcher", "mapper", "image_undistorter"}) {
        ::setenv("COLMAP_FAILS_AT", stage, 1);
        const std::string message = failure();
        EXPECT_NE(message.find(std::string("colmap ") + stage + " ended with exit code 3"), std::string::npos)
            << message;
        EXPECT_NE(message.find("Something specific is broken"), std::string::npos);
        EXPECT_NE(message.find((options_.scene / "colmap-failed.log").string()), std::string::npos) << message;
        EXPECT_TRUE(only_the_log_is_left()) << stage << ", which the next attempt replaces";
        EXPECT_NE(text_of(options_.scene / "colmap-failed.log").find("so far (1)\n"), std::string::npos)
            << "all lines, not the last ones";
    }
    ::setenv("COLMAP_FAILS_AT", "model_analyzer", 1);
    const PrepareReport report = prepare();
    EXPECT_FALSE(report.error) << "a figure that is missing costs no scene";
    EXPECT_EQ(report.registered, 2u);
    fs::remove_all(options_.scene);
    ::unsetenv("COLMAP_FAILS_AT");
    for (const char* how : {"1", "as an error"}) {
        ::setenv("COLMAP_FINDS_NOTHING", how, 1);
        EXPECT_NE(failure().find("no camera positions"), std::string::npos) << how;
        EXPECT_TRUE(only_the_log_is_left());
    }
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
    options_.source = folder_.path() / "empty";
    fs::create_directories(options_.source);
    EXPECT_THROW(prepare(), DataError);
    options_.source = folder_.path() / "missing";
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

TEST_F(Prepare, PhotographsInFormatsThatAreNotReadAreNamed) {
    folder_.write("photographs/IMG_1.HEIC", "a photograph of a phone");
    const PrepareReport report = prepare_scene(options_, [](int, int, const std::string&, const std::string&) {});
    EXPECT_NE(
        describe(report).back().find("1 photographs are in formats that are not read: passed over (first: IMG_1.HEIC)"),
        std::string::npos);
    fs::remove(photographs() / "a.png");
    fs::remove(photographs() / "sub" / "b.png");
    const std::string message = test::message_of<DataError>([&] { find_photographs(photographs()); });
    EXPECT_NE(message.find("no photographs found; "), std::string::npos) << message;
    EXPECT_NE(message.find("IMG_1.HEIC"), std::string::npos) << message;
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

TEST_F(Prepare, MasksBesidePhotographsAreNotGivenToColmap) {
    test::write_tagged(photographs() / "a.png.mask.png", 3, 2, 1);
    EXPECT_EQ(failure(), "");
    const fs::path seen = folder_.path() / "calls.seen";
    EXPECT_FALSE(fs::exists(seen / "a.png.mask.png"));
    EXPECT_EQ(text_of(seen / "a.png"), text_of(photographs() / "a.png"));
    EXPECT_NE(calls().find("--ImageReader.single_camera 1"), std::string::npos) << "its size does not count";
}

TEST_F(Prepare, UprightAndLevelPhotographsOfOneDeviceStillShareOneCamera) {
    test::write_tagged(photographs() / "turned.jpg", 8, 6, 6);
    prepare();
    EXPECT_EQ(read_image_info(folder_.path() / "calls.seen" / "turned.jpg").width, 8) << "as stored";
    EXPECT_NE(calls().find("--ImageReader.single_camera 1"), std::string::npos);
}

TEST_F(Prepare, SaysWhatCameOfThePhotographs) {
    number_photographs("p", 18);
    std::vector<std::string> registered = {"a.png", "p0000.png", "p0001.png", "p0002.png", "p0003.png"};
    register_photographs(registered);
    const PrepareReport report = prepare();
    EXPECT_EQ(report.photographs, 20u);
    EXPECT_EQ(report.left_out.size(), 15u);
    EXPECT_TRUE(is_poor(report));
    const std::vector<std::string> lines = describe(report);
    ASSERT_EQ(lines.size(), 3u);
    EXPECT_EQ(lines[0], "5 of 20 photographs registered, 4 points, mean reprojection error 0.48 px");
    EXPECT_EQ(lines[1],
              "left out: p0004.png, p0005.png, p0006.png, p0007.png, p0008.png, p0009.png, p0010.png, p0011.png, "
              "p0012.png, p0013.png and 5 more");
    EXPECT_NE(lines[2].find("2 reconstructions"), std::string::npos) << lines[2];
    EXPECT_NE(lines[2].find("the others hold 1 photographs"), std::string::npos) << lines[2];
}

TEST(PrepareReport, WarnsBelowNineTenthsAndGroupsDigits) {
    PrepareReport report;
    report.photographs = 20;
    report.registered = 18;
    report.points = 1234567;
    EXPECT_FALSE(is_poor(report));
    EXPECT_EQ(describe(report), std::vector<std::string>{"18 of 20 photographs registered, 1,234,567 points"});
    report.error = 1.0;
    EXPECT_EQ(describe(report).size(), 1u);
    report.error = 1.4;
    EXPECT_NE(describe(report).at(1).find("--refine-cameras auto"), std::string::npos);
    report.error.reset();
    report.registered = 17;
    report.is_video = true;
    report.points = 345;
    EXPECT_TRUE(is_poor(report));
    EXPECT_EQ(describe(report)[0], "17 of 20 frames registered, 345 points");
}

TEST_F(Prepare, TheProgramsOwnHelpSaysHowItsOptionsAreCalled) {
    ::setenv("COLMAP_STYLE", "4.1", 1);
    install("nvidia-smi", "#!/bin/sh\nexit 0\n");
    prepare();
    EXPECT_NE(calls().find("--FeatureExtraction.use_gpu 1\n"), std::string::npos) << calls();
    EXPECT_NE(calls().find("--FeatureMatching.use_gpu 1\n"), std::string::npos);
    EXPECT_EQ(calls().find("Sift"), std::string::npos);
    EXPECT_NE(shown_.find("1/4 features 2/2\n2/4 matching \n2/4 matching 4/9\n3/4 registered \n3/4 registered 2/2\n"),
              std::string::npos)
        << shown_;
}

TEST_F(Prepare, TheGpuIsUsedWhereColmapAndTheMachineHaveOne) {
    EXPECT_FALSE(options_.gpu);
    prepare();
    EXPECT_NE(calls().find("--SiftMatching.use_gpu 0"), std::string::npos) << "3.8 has no CUDA";
    options_.overwrite = true;
    options_.gpu = true;
    EXPECT_NE(failure().find("COLMAP 3.8 was built without CUDA"), std::string::npos);
    options_.gpu.reset();
    ::setenv("COLMAP_STYLE", "4.1", 1);
    install("nvidia-smi", "#!/bin/sh\nexit 9\n");
    EXPECT_EQ(failure(), "");
    EXPECT_NE(calls().find("--FeatureExtraction.use_gpu 0"), std::string::npos) << "no GPU in the machine";
    install("nvidia-smi", "#!/bin/sh\nexit 0\n");
    options_.gpu = false;
    EXPECT_EQ(failure(), "");
    EXPECT_EQ(calls().find("use_gpu 1"), std::string::npos) << "--cpu";
}

TEST_F(Prepare, MatchingFollowsNumberAndNames) {
    ColmapProgram colmap;
    const auto command = [&](const std::vector<std::string>& names, bool video = false) {
        return choose_matching(options_, names, video, colmap).command;
    };
    std::vector<std::string> few, numbered, mixed;
    for (int i = 0; i < 300; ++i) few.push_back(fmt::format("IMG_{:04}.jpg", i));
    numbered = few;
    numbered.push_back("IMG_0300.jpg");
    mixed = numbered;
    mixed.back() = "market.jpg";
    EXPECT_EQ(command(few), "exhaustive_matcher");
    EXPECT_EQ(command(numbered), "sequential_matcher");
    EXPECT_EQ(command(mixed), "exhaustive_matcher");
    EXPECT_NE(choose_matching(options_, mixed, false, colmap).words.find("--vocab-tree"), std::string::npos);
    EXPECT_EQ(command({}, true), "sequential_matcher") << "a video, however short";
    options_.matching = "vocab-tree";
    EXPECT_THROW(command(few), UsageError) << "there is no vocabulary tree";
    // One where colmap keeps them; those for later versions do not count.
    options_.matching = "auto";
    const fs::path cache = folder_.path() / ".cache" / "colmap";
    fs::create_directories(cache);
    std::ofstream(cache / "1-vocab_tree_faiss_flickr100K_words256K.bin") << "tree";
    EXPECT_EQ(command(mixed), "exhaustive_matcher");
    std::ofstream(cache / "vocab_tree_flickr100K_words32K.bin") << "tree";
    const Matching found = choose_matching(options_, mixed, false, colmap);
    EXPECT_EQ(found.command, "vocab_tree_matcher");
    EXPECT_EQ(found.arguments, (std::vector<std::string>{"--VocabTreeMatching.vocab_tree_path",
                                                         (cache / "vocab_tree_flickr100K_words32K.bin").string()}));
    const Matching loops = choose_matching(options_, {}, true, colmap);
    EXPECT_EQ(loops.command, "sequential_matcher");
    EXPECT_EQ(loops.arguments, (std::vector<std::string>{"--SequentialMatching.loop_detection", "1",
                                                         "--SequentialMatching.vocab_tree_path",
                                                         (cache / "vocab_tree_flickr100K_words32K.bin").string()}));
    ::setenv("COLMAP_STYLE", "4.1", 1);
    ColmapProgram later;
    EXPECT_NE(choose_matching(options_, mixed, false, later).arguments[1].find("faiss"), std::string::npos);
    // What is named is done.
    options_.vocab_tree = cache / "vocab_tree_flickr100K_words32K.bin";
    EXPECT_EQ(command(few), "vocab_tree_matcher");
    options_.matching = "exhaustive";
    EXPECT_EQ(command(numbered), "exhaustive_matcher");
    options_.matching = "sequential";
    EXPECT_EQ(command(few), "sequential_matcher");
    options_.vocab_tree = cache / "missing.bin";
    EXPECT_THROW(command(few), UsageError);
    options_.matching = "all";
    EXPECT_NE(failure().find("--matching: 'all'"), std::string::npos);
}

TEST(Matching, NumberedNamesHaveOneFormAndNumbersOfOneLength) {
    EXPECT_TRUE(numbered_in_order({"DSC_0998.jpg", "DSC_0999.jpg", "DSC_1003.jpg"}));
    EXPECT_TRUE(numbered_in_order({"a/7.png", "a/9.png"}));
    EXPECT_FALSE(numbered_in_order({"10.png", "9.png"})) << "colmap would take 10 for the first";
    EXPECT_FALSE(numbered_in_order({"a/7.png", "b/8.png"}));
    EXPECT_FALSE(numbered_in_order({"door.png", "window.png"}));
    EXPECT_FALSE(numbered_in_order({}));
}

TEST(ColmapMessages, CountsAreRead) {
    const auto text = [](const std::optional<StageCount>& count) {
        return count ? fmt::format("{}/{}", count->done, count->total) : "";
    };
    EXPECT_EQ(text(count_in("Processed file [3/67]")), "3/67");
    EXPECT_EQ(text(count_in("I20260101 10:00:00.123456 77 feature_extraction.cc:258] Processed file [3/67]")), "3/67");
    EXPECT_EQ(text(count_in("Matching block [2/3, 1/3] in 28.552s")), "4/9");
    for (const char* line : {"Processed file", "[a/b]", "[3/]", "[1/2", "[1/99999999999999999999]"})
        EXPECT_EQ(text(count_in(line)), "") << line;
    EXPECT_EQ(text(registered_in("Registering image #3 (12)")), "12/0");
    EXPECT_EQ(text(registered_in("I20260101 incremental_pipeline.cc:478] Registering image #3 (num_reg_frames=12)")),
              "12/0");
    EXPECT_EQ(text(registered_in("  => Image sees 318 / 511 points")), "");
    EXPECT_EQ(reprojection_error_in("I20260101 model.cc:7] Mean reprojection error: 0.479041px"), 0.479041);
    EXPECT_FALSE(reprojection_error_in("Mean reprojection error: nanpx"));
}

/// Prepares a video of twelve frames, of which those named sharp have a pattern.
class PrepareVideo : public Prepare {
  protected:
    void SetUp() override {
        Prepare::SetUp();
        install("ffmpeg", test::kFakeFfmpeg);
        const fs::path frames = folder_.path() / "candidates";
        fs::create_directories(frames);
        ::setenv("FFMPEG_FRAMES", frames.c_str(), 1);
        for (int i = 0; i < 12; ++i) write_image(frames / fmt::format("{:02}.png", i), frame(i));
        options_.source = folder_.write("walk:1.mp4", "a video");
        register_photographs({"frame_00000.jpg", "frame_00001.jpg", "frame_00002.jpg"});
    }
    /// Frames are told apart by their size. 3, 5 and 10 are sharp.
    static Image frame(int i) {
        Image image = picture(32 + i, 16);
        const int contrast = i == 3 || i == 5 || i == 10 ? 100 : 10;
        for (std::size_t p = 0; p < image.u8.size(); ++p)
            image.u8[p] = std::uint8_t(100 + (p / 3 % 2 == 0 ? contrast : 0));
        return image;
    }
};

TEST_F(PrepareVideo, TheSharpestFrameOfEachIntervalIsTaken) {
    options_.fps = 3;
    const PrepareReport report = prepare();
    const fs::path seen = folder_.path() / "calls.seen";
    EXPECT_EQ(std::distance(fs::directory_iterator(seen), fs::directory_iterator()), 3) << "5 + 5 + 2 candidates";
    EXPECT_EQ(read_image_info(seen / "frame_00000.jpg").width, 32 + 3);
    EXPECT_EQ(read_image_info(seen / "frame_00001.jpg").width, 32 + 5);
    EXPECT_EQ(read_image_info(seen / "frame_00002.jpg").width, 32 + 10);
    const std::string asked = text_of(folder_.path() / "calls.ffmpeg");
    EXPECT_NE(asked.find("-i file:" + options_.source.string() + " -vf fps=15 "), std::string::npos) << asked;
    EXPECT_NE(calls().find("offscreen sequential_matcher"), std::string::npos);
    EXPECT_EQ(shown_.find("1/5 frames \n1/5 frames 5/15\n2/5 features \n"), 0u) << shown_;
    EXPECT_EQ(describe(report)[0], "3 of 3 frames registered, 4 points, mean reprojection error 0.48 px");
    EXPECT_NE(text_of(report.log).find("$ ffmpeg "), std::string::npos);
    EXPECT_EQ(std::distance(fs::directory_iterator(parent()), fs::directory_iterator()), 1) << "no candidates left";
}

TEST_F(PrepareVideo, MistakesNameTheirCause) {
    options_.fps = 0;
    EXPECT_NE(failure().find("--fps is 0"), std::string::npos);
    options_.fps.reset();
    ::setenv("FFMPEG_FAILS", "1", 1);
    const std::string message = failure();
    EXPECT_NE(message.find("ffmpeg ended with exit code 1"), std::string::npos) << message;
    EXPECT_NE(message.find("moov atom not found"), std::string::npos) << message;
    EXPECT_TRUE(only_the_log_is_left());
    ::unsetenv("FFMPEG_FAILS");
    const fs::path one = folder_.path() / "one";
    fs::create_directories(one);
    write_image(one / "0.png", picture(8, 6));
    ::setenv("FFMPEG_FRAMES", one.c_str(), 1);
    EXPECT_NE(failure().find("gives 1 frames at 2 a second"), std::string::npos);
    options_.source = photographs();
    options_.fps = 2;
    EXPECT_NE(failure().find("--fps is for a video"), std::string::npos);
}

TEST_F(PrepareVideo, WithoutFfmpegItSaysHowToGetIt) {
    fs::remove(folder_.path() / "ffmpeg");
    const fs::path tools = folder_.path() / "tools";  // a PATH with what the stand-in for colmap needs
    fs::create_directories(tools);
    fs::create_symlink("/bin/sh", tools / "sh");
    ::setenv("PATH", (folder_.path().string() + ":" + tools.string()).c_str(), 1);
    EXPECT_NE(failure().find("apt-get install ffmpeg"), std::string::npos);
    EXPECT_TRUE(nothing_left());
}

TEST(PrepareRealPrograms, ColmapSaysWhatItIsAndHasTheOptions) {
    try {
        ColmapProgram colmap;
        EXPECT_NE(colmap.version().find("COLMAP "), std::string::npos) << colmap.version();
        for (const char* command :
             {"feature_extractor", "exhaustive_matcher", "sequential_matcher", "vocab_tree_matcher"})
            EXPECT_TRUE(colmap.option(command, "use_gpu").starts_with("--")) << command;
        EXPECT_TRUE(colmap.option("vocab_tree_matcher", "vocab_tree_path").starts_with("--"));
        EXPECT_TRUE(colmap.option("sequential_matcher", "loop_detection").ends_with(".loop_detection"));
        EXPECT_EQ(colmap.option("mapper", "no_such_option"), "");
        EXPECT_NE(colmap.help("model_analyzer").find("--path"), std::string::npos);
    } catch (const UsageError& e) {
        GTEST_SKIP() << e.what();
    }
}

TEST(PrepareRealPrograms, FfmpegGivesTheFramesOfAVideo) {
    const test::TemporaryFolder folder;
    const fs::path video = folder.path() / "100%: a video.mp4", frames = folder.path() / "50% of it" / "frames";
    try {
        const auto made = run_process({"ffmpeg", "-loglevel", "error", "-f", "lavfi", "-i",
                                       "testsrc=duration=3:size=160x120:rate=30", "file:" + video.string()},
                                      {}, [](const std::string&) {});
        if (made.exit_code != 0) GTEST_SKIP() << "this ffmpeg makes no videos";
    } catch (const UsageError& e) {
        GTEST_SKIP() << e.what();
    }
    ProgramLog log(folder.path() / "log");
    std::int64_t most = 0, expected = 0;
    extract_frames(video, 2, frames, log, [&](std::int64_t done, std::int64_t total) {
        most = std::max(most, done);
        expected = total;
    });
    EXPECT_EQ(std::distance(fs::directory_iterator(frames), fs::directory_iterator()), 6) << "3 seconds, 2 a second";
    EXPECT_EQ(read_image_info(frames / "frame_00005.jpg").width, 160);
    EXPECT_EQ(most, 30);
    EXPECT_EQ(expected, 30);
    EXPECT_EQ(std::distance(fs::directory_iterator(frames.parent_path()), fs::directory_iterator()), 1)
        << "no candidates left";
    EXPECT_THROW(extract_frames(folder.write("no.mp4", "no video"), 2, folder.path() / "none", log,
                                [](std::int64_t, std::int64_t) {}),
                 DataError);
}

TEST(Sharpness, FallsWithBlurAndNotWithBrightness) {
    Image sharp = test::gradient_image(32, 32);
    for (int y = 0; y < 32; ++y)
        for (int x = 0; x < 32; ++x)
            for (int c = 0; c < 3; ++c) sharp.u8[std::size_t(3 * (32 * y + x) + c)] = (x / 4 + y / 4) % 2 ? 150 : 50;
    const Image blurred = resize_image(resize_image(sharp, 12, 12), 32, 32);
    Image brighter = sharp;
    for (std::uint8_t& v : brighter.u8) v = std::uint8_t(v + 50);
    EXPECT_GT(sharpness(sharp), 2 * sharpness(blurred));
    EXPECT_NEAR(sharpness(brighter), sharpness(sharp), 1e-6);
    EXPECT_EQ(sharpness(Image{2, 2, 3, std::vector<std::uint8_t>(12, 9), {}}), 0);
}

}  // namespace
}  // namespace gs
