// SPDX-License-Identifier: Apache-2.0
// EXIF orientation: which way pixels are turned, and that copies keep all else.
#include "kernels/base/error.h"
#include "lib/io/image.h"
#include "tests/io/file_helpers.h"
#include "tests/io/tagged_image.h"

namespace gs::test {
namespace {

TEST(Orientation, EachOfTheEightTurnsAsExifSays) {
    const std::vector<std::vector<std::uint8_t>> expected = {{1, 2, 3, 4, 5, 6}, {3, 2, 1, 6, 5, 4}, {6, 5, 4, 3, 2, 1},
                                                             {4, 5, 6, 1, 2, 3}, {1, 4, 2, 5, 3, 6}, {4, 1, 5, 2, 6, 3},
                                                             {6, 3, 5, 2, 4, 1}, {3, 6, 2, 5, 1, 4}};
    for (int orientation = 1; orientation <= 8; ++orientation) {
        Image image{3, 2, 1, {1, 2, 3, 4, 5, 6}, {}}, floats{3, 2, 1, {}, {1, 2, 3, 4, 5, 6}};
        const Image turned = upright(image, orientation), turned_floats = upright(floats, orientation);
        EXPECT_EQ(turned.u8, expected[orientation - 1]) << orientation;
        EXPECT_EQ(turned_floats.f32, std::vector<float>(turned.u8.begin(), turned.u8.end())) << orientation;
        EXPECT_EQ(turned.width, is_quarter_turn(orientation) ? 2 : 3) << orientation;
        EXPECT_EQ(turned.height, is_quarter_turn(orientation) ? 3 : 2) << orientation;
    }
}

TEST(Orientation, IsReadAndDoesNotTurnWhatIsRead) {
    const TempFolder folder;
    write_tagged(folder / "a.jpg", 32, 16, 6);
    write_tagged(folder / "b.jpg", 32, 16, 1);
    EXPECT_EQ(read_image_info(folder / "a.jpg").orientation, 6);
    EXPECT_EQ(read_image_info(folder / "b.jpg").orientation, 1);
    EXPECT_EQ(read_image(folder / "a.jpg").u8, read_image(folder / "b.jpg").u8);
}

TEST(Orientation, AnUprightCopyKeepsTheRest) {
    const TempFolder folder;
    write_tagged(folder / "a.jpg", 32, 16, 6);
    write_upright_copy(folder / "a.jpg", folder / "upright/a.jpg");
    const auto input = OIIO::ImageInput::open((folder / "upright/a.jpg").string());
    ASSERT_TRUE(input);
    EXPECT_EQ(input->spec().get_int_attribute("Orientation", 1), 1);
    EXPECT_NEAR(input->spec().get_float_attribute("ExposureTime"), 0.01f, 1e-5f);
    EXPECT_EQ(input->spec().get_float_attribute("Exif:FocalLength"), 35.0f);
    const Image image = read_image(folder / "upright/a.jpg");
    ASSERT_EQ(image.width, 16);
    ASSERT_EQ(image.height, 32);
    EXPECT_GT(image.value(8, 2, 0), 0.98f) << "what lay on the left is on top";
    EXPECT_LT(image.value(8, 29, 0), 0.02f);

    write_tagged(folder / "c.tif", 4, 2, 3);
    write_upright_copy(folder / "c.tif", folder / "upright/c.tif");
    EXPECT_NEAR(OIIO::ImageInput::open((folder / "upright/c.tif").string())->spec().get_float_attribute("ExposureTime"),
                0.01f, 1e-5f);
    const Image exact = read_image(folder / "upright/c.tif");
    EXPECT_EQ(exact.value(0, 0, 0), 0.0f);
    EXPECT_EQ(exact.value(3, 1, 2), 1.0f);
    spit(folder / "damaged.jpg", slurp(folder / "a.jpg").substr(0, 400));
    EXPECT_CONTAINS(
        message_of<DataError>([&] { write_upright_copy(folder / "damaged.jpg", folder / "upright/damaged.jpg"); }),
        "damaged.jpg");
}

TEST(Orientation, NoUprightCopyIsMadeOfATruncatedPhotograph) {
    const TempFolder folder;
    write_tagged(folder / "a.jpg", 320, 160, 6);
    const std::string whole = slurp(folder / "a.jpg");
    spit(folder / "cut.jpg", whole.substr(0, whole.size() - 200));
    EXPECT_CONTAINS(message_of<DataError>([&] { write_upright_copy(folder / "cut.jpg", folder / "upright/cut.jpg"); }),
                    "cut.jpg");
    EXPECT_FALSE(std::filesystem::exists(folder / "upright/cut.jpg"));
}

}  // namespace
}  // namespace gs::test
