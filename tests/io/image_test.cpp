// SPDX-License-Identifier: Apache-2.0
// Decoding and encoding: bit depths, channel layouts, straight alpha, damaged files.
#include "lib/io/image.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <numeric>

#include "kernels/base/error.h"
#include "tests/io/file_helpers.h"
#include "tests/io/limits.h"
#include "tests/io/tagged_image.h"

// OpenImageIO 2.4 itself loses the text of each decoding error; without the leak checker nobody calls this.
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() { return "leak:ImageInput::geterror\n"; }

namespace gs::test {
namespace {

using test::message_of;
using test::TempFolder;

Image make_image(int width, int height, int channels) {
    Image image{width, height, channels, {}, {}};
    image.u8.resize(std::size_t(width) * height * channels);
    for (std::size_t i = 0; i < image.u8.size(); ++i) image.u8[i] = static_cast<std::uint8_t>(i * 37 + 11);
    return image;
}

/// Writes raw samples through OpenImageIO, for layouts that write_image does not make.
template <class T>
void write_raw(const std::filesystem::path& path, int width, int height, int channels, OIIO::TypeDesc type,
               const std::vector<T>& samples) {
    OIIO::ImageSpec spec(width, height, channels, type);
    if (channels == 2) {
        spec.channelnames = {"Y", "A"};
        spec.alpha_channel = 1;
    }
    spec.attribute("oiio:UnassociatedAlpha", 1);
    auto out = OIIO::ImageOutput::create(path.string());
    ASSERT_TRUE(out && out->open(path.string(), spec) && out->write_image(type, samples.data()) && out->close());
}

TEST(Image, LosslessFormatsKeepEightBitPixelsAndStraightAlpha) {
    TempFolder folder;
    for (const char* name : {"a.png", "a.tif"})
        for (const int channels : {3, 4}) {
            const Image image = make_image(7, 5, channels);
            write_image(folder / name, image);
            EXPECT_EQ(read_image(folder / name).u8, image.u8) << name << " with " << channels << " channels";
            const ImageInfo info = read_image_info(folder / name);
            EXPECT_EQ(info.width, 7);
            EXPECT_EQ(info.height, 5);
            EXPECT_EQ(info.channels, channels);
            EXPECT_FALSE(info.float_data);
        }
    EXPECT_EQ(folder.num_entries(), 2u) << "temporary files are left";
}

TEST(Image, WebpIsReadWithStraightAlpha) {
    TempFolder folder;
    // 16x16 lossless, made with libwebp: upper half (200,100,50,128), lower half (10,250,120,30).
    const std::uint8_t bytes[] = {82, 73, 70, 70, 42,  0,   0,   0,   87,  69,  66, 80,  86,  80,  56, 76, 30,
                                  0,  0,  0,  47, 15,  192, 3,   16,  15,  112, 53, 253, 43,  248, 30, 79, 247,
                                  30, 98, 17, 14, 177, 96,  146, 191, 116, 231, 20, 34,  250, 159, 51, 2};
    test::spit(folder / "a.webp", std::string(std::begin(bytes), std::end(bytes)));
    const Image image = read_image(folder / "a.webp");
    ASSERT_EQ(image.u8.size(), 16u * 16 * 4);
    // The decoder premultiplies, so that colours come back to within half a step divided by alpha.
    const int upper[4] = {200, 100, 50, 128}, lower[4] = {10, 250, 120, 30};
    for (int c = 0; c < 4; ++c) {
        EXPECT_NEAR(image.u8[c], upper[c], c == 3 ? 0 : 2);
        EXPECT_NEAR(image.u8[1020 + c], lower[c], c == 3 ? 0 : 5);
    }
    EXPECT_CONTAINS(message_of<DataError>([&] { write_image(folder / "b.webp", image); }), "use PNG");
    write_image(folder / "b.webp", Image{16, 16, 3, std::vector<std::uint8_t>(16 * 16 * 3, 100), {}});
    for (const std::uint8_t v : read_image(folder / "b.webp").u8) EXPECT_NEAR(v, 100, 3);
}

TEST(Image, PngKeepsColourUnderZeroAlpha) {
    TempFolder folder;
    Image image = make_image(2, 1, 4);
    image.u8 = {10, 20, 30, 0, 40, 50, 60, 255};
    write_image(folder / "a.png", image);
    EXPECT_EQ(read_image(folder / "a.png").u8, image.u8);
}

TEST(Image, JpegIsCloseAndHasNoAlpha) {
    TempFolder folder;
    Image image{16, 16, 3, std::vector<std::uint8_t>(16 * 16 * 3, 100), {}};
    write_image(folder / "a.jpg", image);
    const Image back = read_image(folder / "a.jpg");
    EXPECT_EQ(back.channels, 3);
    for (const std::uint8_t v : back.u8) EXPECT_NEAR(v, 100, 2);
}

TEST(Image, FormatsThatAreEncodedInMemoryComeBack) {
    TempFolder folder;
    const Image image = make_image(7, 5, 3);
    for (const char* name : {"a.bmp", "a.webp", "a.tiff", "a.PNG"}) {
        write_image(folder / name, image);
        EXPECT_EQ(read_image(folder / name).u8.size(), image.u8.size()) << name;
    }
    write_image(folder / "what?.png", image);
    EXPECT_EQ(test::slurp(folder / "what?.png"), test::slurp(folder / "a.PNG"));
    EXPECT_CONTAINS(message_of<DataError>([&] { write_image(folder / "a.jp2", image); }), "use PNG");
    EXPECT_CONTAINS(message_of<DataError>([&] { write_image(folder / "a.xyz", image); }), "a.xyz");
    EXPECT_EQ(folder.num_entries(), 5u);
}

TEST(Image, FullDiskIsADataErrorAndKeepsTheOldPicture) {
    TempFolder folder;
    for (const char* name : {"a.png", "a.jpg"}) {  // the other encoders need threads, which a forked child has not
        const Image old = make_image(7, 5, 3);
        write_image(folder / name, old);
        const std::string before = test::slurp(folder / name);
        const int status = test::in_child([&] {
            test::limit_file_size(10);  // less than what encoders keep back until they close the file
            return test::data_error_status([&] { write_image(folder / name, make_image(9, 9, 3)); }, name,
                                           "File too large");
        });
        EXPECT_EQ(status, 0) << name;
        EXPECT_EQ(test::slurp(folder / name), before) << name;
    }
    EXPECT_EQ(folder.num_entries(), 2u);
}

TEST(Image, GreyIsReplicatedAndGreyAlphaBecomesRgba) {
    TempFolder folder;
    write_raw<std::uint8_t>(folder / "g.png", 2, 1, 1, OIIO::TypeDesc::UINT8, {9, 200});
    EXPECT_EQ(read_image(folder / "g.png").u8, (std::vector<std::uint8_t>{9, 9, 9, 200, 200, 200}));
    write_raw<std::uint8_t>(folder / "ga.png", 2, 1, 2, OIIO::TypeDesc::UINT8, {9, 128, 200, 255});
    EXPECT_EQ(read_image(folder / "ga.png").u8, (std::vector<std::uint8_t>{9, 9, 9, 128, 200, 200, 200, 255}));
    EXPECT_EQ(read_image_info(folder / "ga.png").channels, 4);
}

TEST(Image, SixteenBitBecomesFloatDividedBy65535) {
    TempFolder folder;
    write_raw<std::uint16_t>(folder / "a.png", 2, 1, 3, OIIO::TypeDesc::UINT16, {0, 1, 65535, 256, 32768, 1000});
    const Image image = read_image(folder / "a.png");
    ASSERT_TRUE(image.is_float());
    EXPECT_TRUE(read_image_info(folder / "a.png").float_data);
    const double expected[6] = {0, 1, 65535, 256, 32768, 1000};
    for (int i = 0; i < 6; ++i) EXPECT_NEAR(image.f32[i], expected[i] / 65535, 1e-7);
}

TEST(Mask, WeightIsAlphaIfItVariesAndElseLuma) {
    TempFolder folder;
    const auto mask_of = [&](int channels, const std::vector<std::uint8_t>& values) {
        write_raw<std::uint8_t>(folder / "m.png", 2, 1, channels, OIIO::TypeDesc::UINT8, values);
        return read_mask(folder / "m.png").u8;
    };
    const std::vector<std::uint8_t> white_black{255, 0}, grey_black{100, 0};
    EXPECT_EQ(mask_of(1, {255, 0}), white_black);
    EXPECT_EQ(mask_of(1, {100, 0}), grey_black);
    EXPECT_EQ(mask_of(2, {255, 255, 0, 255}), white_black);
    EXPECT_EQ(mask_of(2, {7, 255, 7, 0}), white_black);
    EXPECT_EQ(mask_of(3, {255, 255, 255, 0, 0, 0}), white_black);
    EXPECT_EQ(mask_of(4, {255, 255, 255, 255, 0, 0, 0, 255}), white_black);
    EXPECT_EQ(mask_of(4, {9, 80, 7, 255, 200, 3, 4, 0}), white_black) << "a cut-out photograph";
}

TEST(Mask, TheLargestValueSaysWhatFullWeightIs) {
    TempFolder folder;
    const std::vector<std::uint8_t> white_black{255, 0};
    for (const auto& values : {std::vector<std::uint8_t>{1, 0}, {255, 0}}) {
        write_raw<std::uint8_t>(folder / "m.png", 2, 1, 1, OIIO::TypeDesc::UINT8, values);
        EXPECT_EQ(read_mask(folder / "m.png").u8, white_black) << int(values[0]);
    }
    for (const auto& values : {std::vector<std::uint16_t>{1, 0}, {255, 0}, {65535, 0}}) {
        write_raw<std::uint16_t>(folder / "m.png", 2, 1, 1, OIIO::TypeDesc::UINT16, values);
        EXPECT_EQ(read_mask(folder / "m.png").u8, white_black) << values[0];
    }
    write_raw<std::uint8_t>(folder / "m.png", 2, 1, 1, OIIO::TypeDesc::UINT8, {0, 0});
    EXPECT_EQ(read_mask(folder / "m.png").u8, (std::vector<std::uint8_t>{0, 0}));
    write_raw<std::uint8_t>(folder / "m.png", 2, 1, 1, OIIO::TypeDesc::UINT8, {1, 1});
    EXPECT_EQ(read_mask(folder / "m.png").u8, (std::vector<std::uint8_t>{255, 255}));
}

TEST(Image, ExrKeepsFloatValuesAndStraightAlpha) {
    TempFolder folder;
    Image image{2, 1, 4, {}, {0.25f, 1.5f, 3.0f, 0.5f, 0.125f, 0.75f, 0.0f, 1.0f}};
    write_image(folder / "a.exr", image);
    const Image back = read_image(folder / "a.exr");
    ASSERT_EQ(back.f32.size(), image.f32.size());
    for (std::size_t i = 0; i < image.f32.size(); ++i) EXPECT_NEAR(back.f32[i], image.f32[i], 1e-6);
}

TEST(Image, FloatIsQuantisedByClampScaleHalfTruncate) {
    TempFolder folder;
    Image image{2, 1, 3, {}, {-1.0f, 0.0f, 2.0f, 0.5f, 1.0f / 255 * 0.499f, 1.0f / 255 * 0.501f}};
    write_image(folder / "a.png", image);
    EXPECT_EQ(read_image(folder / "a.png").u8, (std::vector<std::uint8_t>{0, 0, 255, 128, 0, 1}));
}

TEST(Image, MaskIsAlphaIfPresentElseLuma) {
    TempFolder folder;
    write_raw<std::uint8_t>(folder / "g.png", 2, 1, 1, OIIO::TypeDesc::UINT8, {0, 255});
    EXPECT_EQ(read_mask(folder / "g.png").u8, (std::vector<std::uint8_t>{0, 255}));
    write_raw<std::uint8_t>(folder / "a.png", 2, 1, 4, OIIO::TypeDesc::UINT8, {255, 255, 255, 7, 0, 0, 0, 99});
    const Image mask = read_mask(folder / "a.png");
    EXPECT_EQ(mask.channels, 1);
    EXPECT_EQ(mask.u8, (std::vector<std::uint8_t>{7, 99}));
}

TEST(Image, ExtraChannelsAreDropped) {
    TempFolder folder;
    write_raw<float>(folder / "a.exr", 1, 1, 5, OIIO::TypeDesc::FLOAT, {0.1f, 0.2f, 0.3f, 1.0f, 9.0f});
    const Image image = read_image(folder / "a.exr");
    EXPECT_EQ(image.channels, 4);
    EXPECT_NEAR(image.f32[2], 0.3f, 1e-6);
}

TEST(ImageErrors, NameTheFileAndTheReason) {
    TempFolder folder;
    EXPECT_CONTAINS(message_of<DataError>([&] { read_image(folder / "none.png"); }), "none.png: No such file");
    test::spit(folder / "empty.jpg", "");
    EXPECT_CONTAINS(message_of<DataError>([&] { read_image_info(folder / "empty.jpg"); }), "0 bytes");
    test::spit(folder / "text.png", "this is not an image");
    EXPECT_CONTAINS(message_of<DataError>([&] { read_image(folder / "text.png"); }), "text.png: cannot be decoded");
}

TEST(ImageErrors, TruncatedFilesAreRefused) {
    TempFolder folder;
    write_image(folder / "a.png", make_image(64, 64, 3));
    const std::string bytes = test::slurp(folder / "a.png");
    for (const std::size_t size : {std::size_t(10), std::size_t(40), bytes.size() / 2}) {
        test::spit(folder / "b.png", bytes.substr(0, size));
        EXPECT_THROW(read_image(folder / "b.png"), DataError) << size << " of " << bytes.size() << " bytes";
    }
}

TEST(ImageErrors, TruncatedTiffAndJpegAreRefusedThoughTheirDecodersGoOn) {
    TempFolder folder;
    for (const char* compression : {"none", "lzw", "zip", "packbits"}) {
        OIIO::ImageSpec spec(64, 64, 3, OIIO::TypeDesc::UINT8);
        spec.attribute("compression", compression);
        auto out = OIIO::ImageOutput::create("tiff");
        ASSERT_TRUE(out && out->open((folder / "a.tif").string(), spec) &&
                    out->write_image(OIIO::TypeDesc::UINT8, make_image(64, 64, 3).u8.data()) && out->close());
        const std::string bytes = test::slurp(folder / "a.tif");
        EXPECT_EQ(read_image(folder / "a.tif").u8, make_image(64, 64, 3).u8);
        for (const std::size_t lost : {std::size_t(5), bytes.size() / 3}) {
            test::spit(folder / "b.tif", bytes.substr(0, bytes.size() - lost));
            EXPECT_CONTAINS(message_of<DataError>([&] { read_image(folder / "b.tif"); }), "b.tif: ");
        }
    }
    write_image(folder / "a.jpg", make_image(64, 64, 3));
    const std::string bytes = test::slurp(folder / "a.jpg");
    for (const std::size_t lost : {std::size_t(50), bytes.size() / 3}) {
        test::spit(folder / "b.jpg", bytes.substr(0, bytes.size() - lost));
        EXPECT_CONTAINS(message_of<DataError>([&] { read_image(folder / "b.jpg"); }), "remature end");
    }
    test::spit(folder / "b.jpg", bytes + "appended by a camera");
    EXPECT_EQ(read_image(folder / "b.jpg").width, 64);
}

TEST(ImageErrors, NonFinitePixelsAreNamed) {
    TempFolder folder;
    write_raw<float>(folder / "a.exr", 2, 1, 3, OIIO::TypeDesc::FLOAT,
                     {0, 0, 0, 0, std::numeric_limits<float>::quiet_NaN(), 0});
    EXPECT_CONTAINS(message_of<DataError>([&] { read_image(folder / "a.exr"); }), "pixel (1, 0)");
}

TEST(ImageErrors, FailedWritesLeaveNothing) {
    TempFolder folder;
    EXPECT_THROW(write_image(folder / "a.unknown", make_image(2, 2, 3)), DataError);
    EXPECT_THROW(write_image(folder / "a.png", Image{}), DataError);
    EXPECT_EQ(folder.num_entries(), 0u);
    test::spit(folder / "file", "x");
    EXPECT_CONTAINS(message_of<DataError>([&] { write_image(folder / "file/a.png", make_image(2, 2, 3)); }), "a.png");
    EXPECT_EQ(folder.num_entries(), 1u);
}

TEST(Image, MissingFoldersAreMade) {
    TempFolder folder;
    write_image(folder / "some/new/a.png", make_image(2, 2, 3));
    EXPECT_EQ(read_image(folder / "some/new/a.png").width, 2);
}

TEST(EncodeJpeg, IsAFileThatDecodesToAboutTheSame) {
    Image image{32, 24, 3, {}, {}};
    for (int y = 0; y < 24; ++y)
        for (int x = 0; x < 32; ++x)
            for (int c = 0; c < 3; ++c) image.u8.push_back(std::uint8_t(4 * x + 3 * y));
    const auto bytes = encode_jpeg(image, 90);
    const TempFolder folder;
    const Image back = read_image(folder.write("a.jpg", std::string(bytes.begin(), bytes.end())));
    ASSERT_EQ(back.u8.size(), image.u8.size());
    for (std::size_t i = 0; i < image.u8.size(); ++i) EXPECT_NEAR(back.u8[i], image.u8[i], 6);
    EXPECT_LT(encode_jpeg(image, 30).size(), bytes.size());
    image.f32.assign(image.u8.size(), 0);
    image.u8.clear();
    EXPECT_THROW(encode_jpeg(image, 90), UsageError);
}

// Resizing: exact box averages, means, alpha, enlarging.

Image float_image(int width, int height, int channels, std::vector<float> values) {
    return {width, height, channels, {}, std::move(values)};
}

TEST(Resize, IntegerFactorsAverageBlocks) {
    const Image out = resize_image(float_image(4, 2, 1, {1, 3, 10, 20, 5, 7, 30, 40}), 2, 1);
    EXPECT_FLOAT_EQ(out.f32[0], 4);
    EXPECT_FLOAT_EQ(out.f32[1], 25);
}

TEST(Resize, FractionalFactorsWeighByArea) {
    // 3 -> 2: each output covers one and a half inputs.
    const Image out = resize_image(float_image(3, 1, 1, {1, 2, 4}), 2, 1);
    EXPECT_FLOAT_EQ(out.f32[0], (1 + 0.5f * 2) / 1.5f);
    EXPECT_FLOAT_EQ(out.f32[1], (0.5f * 2 + 4) / 1.5f);
}

TEST(Resize, ShrinkingKeepsTheMean) {
    std::vector<float> values(101 * 67 * 3);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = float((i * 2654435761u % 1000) / 1000.0);
    const Image in = float_image(101, 67, 3, values);
    const auto mean = [](const Image& image) {
        return std::accumulate(image.f32.begin(), image.f32.end(), 0.0) / double(image.f32.size());
    };
    for (const auto& [w, h] : {std::pair{50, 33}, {100, 66}, {7, 5}, {1, 1}})
        EXPECT_NEAR(mean(resize_image(in, w, h)), mean(in), 1e-5);
}

TEST(Resize, InvisibleColourDoesNotBleed) {
    Image in{2, 1, 4, {255, 0, 0, 255, 0, 255, 0, 0}, {}};
    const Image out = resize_image(in, 1, 1);
    EXPECT_EQ(out.u8, (std::vector<std::uint8_t>{255, 0, 0, 128}));
}

TEST(Resize, EnlargingIsLinearBetweenPixelCentres) {
    const Image out = resize_image(float_image(2, 1, 1, {0, 1}), 4, 3);
    const float expected[4] = {0, 0.25f, 0.75f, 1};
    for (int y = 0; y < 3; ++y)
        for (int x = 0; x < 4; ++x) EXPECT_FLOAT_EQ(out.f32[y * 4 + x], expected[x]);
}

TEST(Resize, EightBitRoundsToNearestAndConstantStaysConstant) {
    EXPECT_EQ(resize_image(Image{2, 1, 1, {10, 11}, {}}, 1, 1).u8[0], 11);
    for (const int v : {0, 1, 77, 254, 255}) {
        Image in{13, 9, 3, std::vector<std::uint8_t>(13 * 9 * 3, std::uint8_t(v)), {}};
        for (const auto& [w, h] : {std::pair{5, 4}, {20, 30}, {13, 4}})
            for (const std::uint8_t got : resize_image(in, w, h).u8) EXPECT_EQ(got, v);
    }
}

TEST(Resize, SameSizeIsACopyAndEmptyTargetsAreRefused) {
    const Image in{2, 1, 4, {1, 2, 3, 0, 5, 6, 7, 8}, {}};
    EXPECT_EQ(resize_image(in, 2, 1).u8, in.u8);
    EXPECT_THROW(resize_image(in, 0, 1), UsageError);
}

// EXIF orientation: which way pixels are turned, and that copies keep all else.

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
