// SPDX-License-Identifier: Apache-2.0
// Damaged images are found before the training, and the others are decoded once.
#include "lib/scene/verify_images.h"

#include <algorithm>

#include "kernels/base/error.h"
#include "lib/scene/image_cache.h"
#include "tests/scene/scene_fixture.h"

namespace gs::test {
namespace {

/// The names a.png, b.png, ... of `n` images.
std::vector<std::string> letters(int n) {
    std::vector<std::string> names;
    for (int i = 0; i < n; ++i) names.push_back(std::string(1, char('a' + i)) + ".png");
    return names;
}

void cut_in_half(const std::filesystem::path& file) {
    std::filesystem::resize_file(file, std::filesystem::file_size(file) / 2);
}

/// A scene of ten images 64x48 on a line. With eval, a.png and i.png are test views.
class VerifyImages : public ::testing::Test {
  protected:
    VerifyImages() {
        write_model(folder_ / "sparse/0", {{1, 1, 64, 48, {80, 80, 32, 24}}}, row_of_images(letters(10)),
                    {{1, 0, 0, 0}});
        for (const std::string& name : letters(10)) write_png(image(name), 64, 48);
    }
    std::filesystem::path image(const std::string& name) const { return folder_ / "images" / name; }
    Scene load(bool eval) const {
        SceneOptions options;
        options.source = folder_.path().string();
        options.eval = eval;
        options.scores = eval;
        return load_scene(options);
    }
    static constexpr std::size_t kImageBytes = 64 * 48 * 3;
    TempFolder folder_;
};

void verify(Scene& scene, std::size_t keep_bytes = 1 << 30) {
    verify_images(scene, keep_bytes, [](std::int64_t, std::int64_t) {});
}

TEST_F(VerifyImages, TruncatedTestImageIsAnErrorThatNamesIt) {
    cut_in_half(image("i.png"));
    Scene scene = load(true);  // its header is whole
    const std::string message = message_of<DataError>([&] { verify(scene); });
    EXPECT_CONTAINS(message, "1 of 2 test images");
    EXPECT_CONTAINS(message, image("i.png").string());
}

TEST_F(VerifyImages, UnreadableTestImageIsAnErrorWhenTheSceneIsLoaded) {
    spit(image("i.png"), "");
    EXPECT_CONTAINS(message_of<DataError>([&] { load(true); }), image("i.png").string());
    EXPECT_EQ(load(false).train.size(), 9u) << "without scores it is left out like any other";
}

TEST_F(VerifyImages, UnreadableTrainingImageDoesNotMoveTheSplit) {
    spit(image("c.png"), "");
    const Scene scene = load(true);
    ASSERT_EQ(scene.test.size(), 2u);
    EXPECT_EQ(scene.test[1].name, "i.png");
    EXPECT_EQ(scene.train.size(), 7u);
}

TEST_F(VerifyImages, TruncatedTrainingImageIsSkipped) {
    cut_in_half(image("j.png"));
    Scene scene = load(true);
    const double extent = scene.extent;
    verify(scene);
    EXPECT_EQ(scene.train.size(), 7u);
    EXPECT_EQ(scene.test.size(), 2u);
    EXPECT_LT(scene.extent, extent) << "j.png is the outermost";
    ASSERT_FALSE(scene.notes.empty());
    EXPECT_CONTAINS(scene.notes.back(), "1 of 8 training images cannot be decoded");
    EXPECT_CONTAINS(scene.notes.back(), image("j.png").string());
    for (const std::string& name : letters(9)) cut_in_half(image(name));
    Scene none = load(false);
    EXPECT_CONTAINS(message_of<DataError>([&] { verify(none); }), "10 of 10 training images");
}

TEST_F(VerifyImages, DamagedMaskIsFound) {
    write_png(folder_ / "masks/b.png", 64, 48);
    cut_in_half(folder_ / "masks/b.png");
    Scene scene = load(false);
    verify(scene);
    EXPECT_EQ(scene.train.size(), 9u);
    EXPECT_CONTAINS(scene.notes.back(), "masks/b.png");
}

TEST_F(VerifyImages, MasksThatLeaveNothingOrLittleAreNamedAndCounted) {
    const auto write_mask = [&](const std::string& name, std::uint8_t value) {
        std::filesystem::create_directories(folder_ / "masks");
        write_image(folder_ / "masks" / name, Image{64, 48, 3, std::vector<std::uint8_t>(64 * 48 * 3, value), {}});
    };
    write_mask("b.png", 0), write_mask("c.png", 255), write_mask("d.png", 3), write_mask("e.png", 0);
    for (const MaskMode mode : {MaskMode::kIgnore, MaskMode::kTransparent}) {
        SceneOptions options;
        options.source = folder_.path().string();
        options.mask_mode = mode;
        Scene scene = load_scene(options);
        verify(scene);
        EXPECT_TRUE(mentions(scene.notes, "2 of 4 masks are all black")) << scene.notes.back();
        EXPECT_TRUE(mentions(scene.notes, "masks/b.png, " + (folder_ / "masks/e.png").string()));
        EXPECT_TRUE(mentions(scene.notes, "1 of 4 masks are dark all over"));
        EXPECT_EQ(scene.train.size(), 10u);
    }
}

TEST_F(VerifyImages, NothingIsDecodedTwiceWhereAllFits) {
    Scene scene = load(true);
    const Image first = scene.train[0].load().color;
    std::int64_t done = 0;
    verify_images(scene, 10 * kImageBytes, [&](std::int64_t n, std::int64_t total) {
        EXPECT_EQ(n, ++done);
        EXPECT_EQ(total, 10);
    });
    EXPECT_EQ(done, 10);
    std::filesystem::remove_all(folder_ / "images");
    ImageCache cache(scene.train, 10 * kImageBytes, 0);
    for (std::size_t k = 0; k < scene.train.size(); ++k) cache.get(k);
    EXPECT_EQ(cache.num_decodes(), 0u);
    EXPECT_EQ(cache.get(0)->color.u8, first.u8);
    for (const View& view : scene.test) EXPECT_EQ(view_image(view)->color.width, 64);
}

TEST_F(VerifyImages, ASmallerCacheKeepsTrainingImagesOrNone) {
    for (const std::size_t images : {9, 7}) {
        Scene scene = load(true);
        verify(scene, images * kImageBytes);
        for (const View& view : scene.train) EXPECT_EQ(view.decoded != nullptr, images == 9);
        for (const View& view : scene.test) EXPECT_EQ(view.decoded, nullptr);
    }
}

}  // namespace
}  // namespace gs::test
