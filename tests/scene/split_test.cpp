// SPDX-License-Identifier: Apache-2.0
// The splits that datasets state: which views train, which test, and which do neither.
#include "lib/scene/split.h"

#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using namespace test;
using Names = std::vector<std::string>;

/// Loads a scene of the images images/a.png to images/f.png with these keys in its transforms.json.
Scene scene_with(const std::string& keys, bool eval = true) {
    TempFolder folder;
    Names names;
    for (const std::string& name : numbered(6)) names.push_back("images/" + name);
    write_transforms_scene(folder.path(), names, keys);
    return load_unframed(at(folder.path(), eval));
}

/// The letters of the views' names: "abc".
std::string letters(const std::vector<View>& views) {
    std::string text;
    for (const View& view : views) text += std::filesystem::path(view.name).stem().string();
    return text;
}

constexpr const char* kTrainAndVal =
    "\"train_filenames\": [\"images/a.png\", \"images/b.png\"], \"val_filenames\": [\"images/c.png\"], ";

TEST(GivenSplit, ValTakesThePlaceOfTestAndFramesInNoListDoNotTrain) {
    const Scene scene = scene_with(kTrainAndVal);
    EXPECT_EQ(letters(scene.train), "ab");
    EXPECT_EQ(letters(scene.test), "c");
    EXPECT_CONTAINS(scene.split_rule, "val_filenames of transforms.json, because there is no test_filenames");
    EXPECT_TRUE(mentions(scene.notes, "3 frames are in no list: they neither train nor test"));
    const Scene empty = scene_with(std::string(kTrainAndVal) + "\"test_filenames\": [], ");
    EXPECT_EQ(letters(empty.test), "c");
    EXPECT_CONTAINS(empty.split_rule, "because test_filenames is empty");
}

TEST(GivenSplit, WithATestListTheFramesOfValAreLeftOut) {
    const Scene scene = scene_with(std::string(kTrainAndVal) + "\"test_filenames\": [\"images/d.png\"], ");
    EXPECT_EQ(letters(scene.train), "ab");
    EXPECT_EQ(letters(scene.test), "d");
    EXPECT_CONTAINS(scene.split_rule, "given: test_filenames of transforms.json");
    EXPECT_TRUE(mentions(scene.notes, "1 frames of val_filenames neither train nor test"));
    EXPECT_TRUE(mentions(scene.notes, "2 frames are in no list"));
}

TEST(GivenSplit, WithoutEvalHeldOutFramesDoNotTrainEither) {
    const Scene scene = scene_with(std::string(kTrainAndVal) + "\"test_filenames\": [\"images/d.png\"], ", false);
    EXPECT_EQ(letters(scene.train), "ab");
    EXPECT_TRUE(scene.test.empty());
    EXPECT_CONTAINS(scene.split_rule, "no --eval; the views of test_filenames of transforms.json are held out");
}

TEST(GivenSplit, AFrameThatIsHeldOutAndTrainsIsHeldOut) {
    const Scene scene = scene_with(
        "\"train_filenames\": [\"images/a.png\", \"images/b.png\"], \"test_filenames\": [\"images/b.png\"], ");
    EXPECT_EQ(letters(scene.train), "a");
    EXPECT_EQ(letters(scene.test), "b");
    EXPECT_TRUE(mentions(scene.notes, "1 frames of train_filenames are in test_filenames or val_filenames, too"));
}

TEST(GivenSplit, NamesMayLackFoldersAndExtensions) {
    EXPECT_EQ(
        letters(scene_with("\"test_filenames\": [\"b.png\", \"./images/c\", \"/data/scene/images/d.PNG\"], ").test),
        "bcd");
}

TEST(GivenSplit, TestFramesThatCannotBeUsedAreLeftOut) {
    TempFolder folder;
    for (const char* name : {"a.png", "b.png"}) write_png(folder / name);
    spit(folder / "transforms.json", "{\"fl_x\": 20, \"test_frames\": [" + frame("b.png") +
                                         ", {\"file_path\": \"c.png\", \"transform_matrix\": [[NaN]]}], \"frames\": [" +
                                         frame("a.png", 1) + "]}");
    const Scene scene = load_unframed(at(folder.path(), true));
    EXPECT_EQ(letters(scene.train), "a");
    EXPECT_EQ(letters(scene.test), "b");
    EXPECT_TRUE(mentions(scene.notes, "1 of 2 test_frames are left out because they cannot be used (first: "));
    EXPECT_TRUE(mentions(scene.notes, "test_frame 1"));
}

TEST(GivenSplit, PosesOfFramesThatAreLeftOutDoNotMatter) {
    TempFolder folder;
    std::string frames;
    for (int i = 0; i < 5; ++i) {
        const std::string name = std::string(1, char('a' + i)) + ".png";
        write_png(folder / name);
        frames += (i > 0 ? "," : "") + frame(name, i);
    }
    write_png(folder / "f.png");
    const auto load = [&](const std::string& more) {
        spit(folder / "transforms.json", "{\"fl_x\": 20, \"frames\": [" + frames + more + "]}");
        SceneOptions options = at(folder.path());
        return load_scene(options);
    };
    const Scene without = load(""), with = load("," + frame("f.png", 1e7, ", \"is_bad\": true"));
    EXPECT_EQ(letters(with.train), "abcde");
    EXPECT_EQ(with.frame.scale, without.frame.scale);
    EXPECT_EQ(with.frame.center, without.frame.center);
    EXPECT_FALSE(mentions(with.notes, "stand far outside"));
}

TEST(GivenSplit, NamesThatMatchNoFrameAreNoted) {
    const Scene scene = scene_with("\"test_filenames\": [\"images/gone.png\"], ");
    EXPECT_TRUE(mentions(scene.notes, "1 of 1 names in test_filenames match no frame: ignored (images/gone.png)"));
    EXPECT_CONTAINS(scene.split_rule, "index % 8 == 0");
    const Scene some = scene_with("\"test_filenames\": [\"images/gone.png\", \"images/f.png\"], ");
    EXPECT_EQ(letters(some.test), "f");
    EXPECT_TRUE(mentions(some.notes, "1 of 2 names in test_filenames"));
}

TEST(GivenSplit, BadFramesAreLeftOut) {
    TempFolder folder;
    for (const char* name : {"a.png", "b.png", "c.png"}) write_png(folder / name);
    spit(folder / "transforms.json", "{\"fl_x\": 20, \"frames\": [" + frame("a.png") + "," +
                                         frame("b.png", 1, ", \"is_bad\": true") + "," +
                                         frame("c.png", 2, ", \"is_bad\": false") + "]}");
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(letters(scene.train), "ac");
    EXPECT_TRUE(mentions(scene.notes, "frames of transforms.json: 1 are marked is_bad: left out (b.png)"));
}

TEST(GivenSplit, TestFramesTestAndNeverTrain) {
    TempFolder folder;
    for (const char* name : {"a.png", "b.png", "c.png", "d.png"}) write_png(folder / name);
    spit(folder / "transforms.json", "{\"fl_x\": 20, \"test_frames\": [" + frame("b.png") + "," +
                                         frame("d.png", 1, ", \"is_bad\": true") + "], \"frames\": [" +
                                         frame("a.png", 1) + "," + frame("b.png", 2) + "," + frame("c.png", 3) + "]}");
    const Scene scene = load_unframed(at(folder.path(), true));
    EXPECT_EQ(letters(scene.train), "ac") << "b.png is in both lists";
    EXPECT_EQ(letters(scene.test), "b");
    EXPECT_CONTAINS(scene.split_rule, "test_frames of transforms.json");
    EXPECT_TRUE(mentions(scene.notes, "test_frames of transforms.json: 1 are marked is_bad: left out (d.png)"));
    EXPECT_EQ(letters(load_unframed(at(folder.path())).train), "ac");
}

TEST(GivenSplit, ASplitThatLeavesNothingToTrainIsRefused) {
    TempFolder folder;
    write_transforms_scene(folder.path(), {"a.png"}, "\"test_filenames\": [\"a.png\"], ");
    EXPECT_CONTAINS(error_of(at(folder.path(), true)), "test_filenames of transforms.json leaves no view to train");
}

TEST(GivenSplit, ATestListOfTheCommandLineReplacesIt) {
    TempFolder folder;
    write_transforms_scene(folder.path(), {"a.png", "b.png", "c.png", "d.png"}, "\"test_filenames\": [\"a.png\"], ");
    spit(folder / "list.txt", "b\n");
    SceneOptions options = at(folder.path(), true);
    options.test_list = (folder / "list.txt").string();
    const Scene scene = load_unframed(options);
    EXPECT_EQ(letters(scene.test), "b");
    EXPECT_EQ(letters(scene.train), "cd");
    EXPECT_CONTAINS(scene.split_rule, "those of test_filenames of transforms.json do not train either");
}

TEST(GivenSplit, TestTxtOfAColmapModelTests) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "left/b.png", "c.png"});
    spit(folder / "sparse/0/test.txt", "b.png\r\nc\ngone.png\n");
    const Scene scene = load_unframed(at(folder.path(), true));
    EXPECT_EQ(letters(scene.train), "a");
    EXPECT_EQ(letters(scene.test), "cb");
    EXPECT_CONTAINS(scene.split_rule, "given: test.txt of the model");
    EXPECT_TRUE(mentions(scene.notes, "1 of 3 lines name no image: ignored (gone.png)"));
    const Scene all = load_unframed(at(folder.path()));
    EXPECT_EQ(all.train.size(), 3u);
    EXPECT_CONTAINS(all.split_rule, "the test views of test.txt of the model train as well, as in 3DGS");
}

TEST(GivenSplit, FoldersOfImagesMayBeASplit) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"train/a.png", "test/b.png", "val/c.png", "train/d.png"});
    const Scene scene = load_unframed(at(folder.path(), true));
    EXPECT_EQ(letters(scene.train), "ad");
    EXPECT_EQ(letters(scene.test), "b");
    EXPECT_CONTAINS(scene.split_rule, "given: the image folders train and test");
    EXPECT_TRUE(mentions(scene.notes, "1 images of the folder val neither train nor test"));
    TempFolder other;
    write_colmap_scene(other.path(), {"train/a.png", "test/b.png", "more/c.png"});
    EXPECT_CONTAINS(load_unframed(at(other.path(), true)).split_rule, "index % 8 == 0");
    TempFolder transforms;
    write_transforms_scene(transforms.path(), {"images/Train/a.png", "images/Val/b.png"});
    EXPECT_EQ(letters(load_unframed(at(transforms.path(), true)).test), "b");
}

TEST(GivenSplit, ValFramesOfASyntheticSceneTestWithoutOthers) {
    TempFolder folder;
    for (const char* part : {"train", "val"}) {
        write_png(folder / part / "r_0.png");
        spit(folder / ("transforms_" + std::string(part) + ".json"),
             "{\"camera_angle_x\": 0.8, \"frames\": [" + frame(std::string(part) + "/r_0") + "]}");
    }
    EXPECT_EQ(names_of(load_unframed(at(folder.path(), true)).test), Names{"val/r_0.png"});
    EXPECT_EQ(names_of(load_unframed(at(folder.path())).train), Names{"train/r_0.png"});
}

}  // namespace
}  // namespace gs
