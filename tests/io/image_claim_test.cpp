// SPDX-License-Identifier: Apache-2.0
// Images that declare more than their files can hold are refused at once; images that are small because they are simple
// are not.
#include "lib/io/image_claim.h"

#include <OpenImageIO/imageio.h>
#include <sys/stat.h>

#include <cstring>

#include "kernels/base/error.h"
#include "lib/io/image.h"
#include "tests/io/file_helpers.h"

namespace gs {
namespace {

using test::message_of;
using test::TempFolder;

void put(std::string& bytes, std::size_t at, std::uint64_t value, int size, bool big_endian = false) {
    for (int i = 0; i < size; ++i) bytes[at + (big_endian ? size - 1 - i : i)] = char(value >> 8 * i);
}

std::string header_of_png(std::uint32_t width, std::uint32_t height, bool interlaced) {
    std::string png("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\0\0\0\0\0\x08\x02\0\0\0\0\0\0\0", 33);
    put(png, 16, width, 4, true), put(png, 20, height, 4, true);
    png[28] = interlaced ? 1 : 0;
    return png + std::string(1163, 'x');
}

/// A TIFF with one strip for the whole image, whose file holds 1000 bytes of it.
std::string claiming_tiff(std::uint32_t width, std::uint32_t height, std::uint32_t compression) {
    struct Entry {
        std::uint32_t tag, type, count, value;
    };
    constexpr std::uint32_t kShort = 3, kLong = 4;
    const Entry entries[] = {{256, kLong, 1, width},        {257, kLong, 1, height}, {258, kShort, 1, 8},
                             {259, kShort, 1, compression}, {262, kShort, 1, 1},     {273, kLong, 1, 200},
                             {277, kShort, 1, 1},           {278, kLong, 1, height}, {279, kLong, 1, 1000}};
    std::string tiff(1200, '\0');
    std::memcpy(tiff.data(), "II*\0\x08\0\0\0", 8);
    put(tiff, 8, std::size(entries), 2);
    std::size_t at = 10;
    for (const Entry& e : entries) {
        put(tiff, at, e.tag, 2), put(tiff, at + 2, e.type, 2), put(tiff, at + 4, e.count, 4);
        put(tiff, at + 8, e.value, 4);
        at += 12;
    }
    return tiff;
}

std::string claiming_bmp(std::uint32_t width, std::uint32_t height, std::uint32_t compression) {
    std::string bmp(1200, '\0');
    std::memcpy(bmp.data(), "BM", 2);
    put(bmp, 2, bmp.size(), 4), put(bmp, 10, 54, 4), put(bmp, 14, 40, 4);
    put(bmp, 18, width, 4), put(bmp, 22, height, 4), put(bmp, 26, 1, 2), put(bmp, 28, compression ? 8 : 24, 2);
    put(bmp, 30, compression, 4);
    return bmp;
}

/// A file that OpenImageIO wrote, with its width and height replaced.
std::string resized_jpeg(std::string jpeg, std::uint32_t width, std::uint32_t height, char frame) {
    const std::size_t sof = jpeg.find(std::string("\xff\xc0\0\x11", 4));
    EXPECT_NE(sof, std::string::npos);
    jpeg[sof + 1] = frame;
    put(jpeg, sof + 5, height, 2, true), put(jpeg, sof + 7, width, 2, true);
    return jpeg;
}

std::string resized_exr(std::string exr, std::uint32_t width, std::uint32_t height) {
    for (const std::string name : {"dataWindow", "displayWindow"}) {
        const std::size_t box = exr.find(name) + name.size() + sizeof "\0box2i" + 4;
        put(exr, box + 8, width - 1, 4), put(exr, box + 12, height - 1, 4);
    }
    return exr;
}

std::string claiming_webp(std::uint32_t width, std::uint32_t height, const char* chunk) {
    std::string webp("RIFF\xc0\x04\0\0WEBP", 12);
    webp += chunk;
    webp.resize(1200, '\0');
    put(webp, 16, 1180, 4);
    if (std::strcmp(chunk, "VP8X") == 0)
        put(webp, 24, width - 1, 3), put(webp, 27, height - 1, 3);
    else if (std::strcmp(chunk, "VP8L") == 0)
        webp[20] = 0x2f, put(webp, 21, (width - 1) | (height - 1) << 14, 4);
    else
        std::memcpy(&webp[20], "\x10\x02\0\x9d\x01\x2a", 6), put(webp, 26, width, 2), put(webp, 28, height, 2);
    return webp;
}

TEST(ImageClaim, SmallFilesWithLargeSizesAreRefusedByNameAndSize) {
    const TempFolder folder;
    const Image small{64, 64, 3, std::vector<std::uint8_t>(64 * 64 * 3, 100), {}};
    write_image(folder / "small.jpg", small);
    write_image(folder / "small.exr", small);
    const std::string jpeg = test::slurp(folder / "small.jpg"), exr = test::slurp(folder / "small.exr");
    const std::pair<const char*, std::string> files[] = {
        {"a.png", header_of_png(22000, 22000, false)},
        {"interlaced.png", header_of_png(22000, 22000, true)},
        {"a.jpg", resized_jpeg(jpeg, 22000, 22000, '\xc0')},
        {"progressive.jpg", resized_jpeg(jpeg, 22000, 22000, '\xc2')},
        {"arithmetic.jpg", resized_jpeg(jpeg, 22000, 22000, '\xc9')},
        {"raw.tif", claiming_tiff(22000, 22000, 1)},
        {"lzw.tif", claiming_tiff(22000, 22000, 5)},
        {"deflate.tif", claiming_tiff(22000, 22000, 8)},
        {"packbits.tif", claiming_tiff(22000, 22000, 32773)},
        {"raw.bmp", claiming_bmp(22000, 22000, 0)},
        {"rle.bmp", claiming_bmp(22000, 22000, 1)},
        {"canvas.webp", claiming_webp(22000, 22000, "VP8X")},
    };
    for (const auto& [name, bytes] : files) {
        test::spit(folder / name, bytes);
        for (const bool whole : {false, true}) {
            const std::string message = message_of<DataError>(
                [&] { whole ? void(read_image(folder / name)) : void(read_image_info(folder / name)); });
            EXPECT_CONTAINS(message, name);
            EXPECT_CONTAINS(message, "declares 22000x22000 pixels");
        }
    }
    // OpenEXR misses the rows' offsets, which come before any pixel.
    test::spit(folder / "b.exr", resized_exr(exr, 22000, 22000));
    EXPECT_CONTAINS(message_of<DataError>([&] { read_image_info(folder / "b.exr"); }), "b.exr: cannot be decoded");
    for (const char* chunk : {"VP8 ", "VP8L"}) {
        test::spit(folder / "a.webp", claiming_webp(16000, 16000, chunk));
        EXPECT_CONTAINS(message_of<DataError>([&] { read_image_info(folder / "a.webp"); }), "16000x16000");
    }
}

TEST(ImageClaim, LargeImagesOfOneColourAreRead) {
    const TempFolder folder;
    const Image white{5000, 4000, 3, std::vector<std::uint8_t>(std::size_t(5000) * 4000 * 3, 255), {}};
    for (const char* name : {"a.png", "a.jpg", "a.tif"}) {
        write_image(folder / name, white);
        const Image back = read_image(folder / name);
        EXPECT_EQ(back.width, 5000) << name;
        EXPECT_EQ(back.u8, white.u8) << name << ", " << std::filesystem::file_size(folder / name) << " bytes";
    }
}

TEST(ImageClaim, FilesBelow100KilobytesGetLessMemory) {
    const TempFolder folder;
    std::string png = header_of_png(13000, 13000, false);
    png[24] = 1, png[25] = 3;  // one bit a pixel, with a palette: 20 KB can hold it
    test::spit(folder / "a.png", png + std::string(90000, 'x'));
    EXPECT_CONTAINS(
        message_of<DataError>([&] { read_image_info(folder / "a.png"); }),
        "declares 13000x13000 pixels, which need 484 MiB of memory; a file of 91196 bytes gets at most 192");
    test::spit(folder / "a.png", png + std::string(600000, 'x'));
    EXPECT_NO_THROW(check_image_claim(folder / "a.png", read_image_claim(folder / "a.png"), 3.0 * 13000 * 13000));
}

TEST(ImageClaim, HeicIsNamedWhateverItsExtension) {
    const TempFolder folder;
    test::spit(folder / "a.jpg", std::string("\0\0\0\x18"
                                             "ftypheic\0\0\0\0mif1heic",
                                             24));
    EXPECT_CONTAINS(message_of<DataError>([&] { read_image(folder / "a.jpg"); }), "it is a HEIC or AVIF file");
}

TEST(ImageClaim, JpegWithBytesBetweenItsSegmentsIsRead) {
    const TempFolder folder;
    const Image grey{640, 480, 3, std::vector<std::uint8_t>(640 * 480 * 3, 100), {}};
    write_image(folder / "a.jpg", grey);
    std::string jpeg = test::slurp(folder / "a.jpg");
    const std::size_t app0 = jpeg.find("\xff\xe0");
    ASSERT_NE(app0, std::string::npos);
    const auto high = static_cast<unsigned char>(jpeg[app0 + 2]), low = static_cast<unsigned char>(jpeg[app0 + 3]);
    jpeg.insert(app0 + 2 + high * 256u + low, 2, '\0');
    test::spit(folder / "b.jpg", jpeg);
    EXPECT_EQ(read_image(folder / "b.jpg").u8, read_image(folder / "a.jpg").u8);
}

TEST(ImageClaim, OnlyAnimatedWebpNeedsCanvases) {
    const TempFolder folder;
    std::string webp = claiming_webp(7000, 7000, "VP8X");
    test::spit(folder / "a.webp", webp);
    EXPECT_EQ(read_image_claim(folder / "a.webp").work_bytes, 4.0 * 7000 * 7000);
    webp[20] = 0x02;
    test::spit(folder / "a.webp", webp);
    EXPECT_EQ(read_image_claim(folder / "a.webp").work_bytes, 12.0 * 7000 * 7000);
}

TEST(ImageClaim, NamesThatOpenImageIoWouldInterpretAreNames) {
    const TempFolder folder;
    const Image image{4, 4, 3, std::vector<std::uint8_t>(48, 7), {}};
    write_image(folder / "a.png", image);
    for (const char* name : {"*?[a]/b.png", "a?b=c.png", "%04d####.png", "a.null", "no_extension"}) {
        test::spit(folder / name, test::slurp(folder / "a.png"));
        EXPECT_EQ(read_image(folder / name).u8, image.u8) << name;
    }
}

TEST(ImageClaim, OtherFormatsAndFragmentsAreRefused) {
    const TempFolder folder;
    const std::string gif = "GIF89a\xff\xff\xff\xff" + std::string(4, '\0');
    const std::string whole[] = {gif,
                                 "P6\n2 2\n255\n" + std::string(12, 'x'),
                                 header_of_png(4, 4, false),
                                 claiming_tiff(4, 4, 1),
                                 claiming_bmp(4, 4, 0),
                                 claiming_webp(4, 4, "VP8L"),
                                 std::string("\xff\xd8\xff\xe0\0\x10JFIF", 10) + std::string(64, '\xff')};
    for (const std::string& bytes : whole)
        for (const std::size_t size :
             {std::size_t(1), std::size_t(4), std::size_t(14), std::size_t(25), bytes.size()}) {
            test::spit(folder / "some.png", bytes.substr(0, size));
            try {
                read_image(folder / "some.png");
            } catch (const DataError& e) {
                EXPECT_CONTAINS(e.what(), "some.png");
            }
        }
    test::spit(folder / "a.gif", gif);
    EXPECT_CONTAINS(message_of<DataError>([&] { read_image(folder / "a.gif"); }), "PNG, JPEG, TIFF, WebP, BMP or EXR");
}

// OpenEXR made room for 1.9 GB when a type of attribute was damaged, and for 16 GB when the sides of a preview were.
TEST(ImageClaim, ExrAttributesThatTheFileCannotHoldAreRefused) {
    const TempFolder folder;
    const std::string start("\x76\x2f\x31\x01\x02\0\0\0", 8), size_and_data("\x08\0\0\0\xff\xff\0\0\xff\xff\0\0", 12);
    const std::pair<std::string, const char*> cases[] = {
        {start + std::string("a\0odd\0rtsi", 10), "attribute 'a' claims 1769174130 bytes"},
        {start + std::string("p\0preview\0", 10) + size_and_data, "attribute 'p' of type preview does not have"},
        {start + std::string("f\0float\0", 8) + size_and_data, "attribute 'f' of type float does not have"},
        {start + std::string("s\0stringvector\0", 15) + size_and_data,
         "attribute 's' of type stringvector does not have"},
        {start + std::string("c\0chlist\0", 9) + size_and_data, "attribute 'c' of type chlist does not have"},
        {start + std::string(400, 'n'), "a name in its header does not end"},
        {start + std::string("a\0odd", 5), "a name in its header does not end"},
    };
    for (const auto& [bytes, reason] : cases) {
        test::spit(folder / "i.exr", bytes);
        EXPECT_CONTAINS(message_of<DataError>([&] { read_image_info(folder / "i.exr"); }), reason);
    }
}

TEST(ImageClaim, AnEmptyDepthMapOfTheLargestSizeIsNotDamaged) {
    const TempFolder folder;
    Image depth{32768, 1024, 1, {}, {}};
    depth.f32.resize(std::size_t(depth.width) * std::size_t(depth.height));
    write_image(folder / "depth.exr", depth);
    EXPECT_LT(std::filesystem::file_size(folder / "depth.exr"), 1u << 20);
    EXPECT_EQ(read_image_info(folder / "depth.exr").width, depth.width);
}

TEST(ImageClaim, PipesAreRefused) {
    const TempFolder folder;
    ASSERT_EQ(::mkfifo((folder / "a.png").c_str(), 0666), 0);
    EXPECT_CONTAINS(message_of<DataError>([&] { read_image(folder / "a.png"); }), "named pipe");
}

}  // namespace
}  // namespace gs
