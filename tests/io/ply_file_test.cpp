// SPDX-License-Identifier: Apache-2.0
// The PLY container: property types, order, and headers that cannot be trusted.
#include "lib/io/ply_file.h"

#include <cmath>
#include <sstream>

#include "kernels/base/error.h"
#include "tests/io/file_helpers.h"

namespace gs::test {
namespace {

std::string read_error(const TempFolder& folder, const std::string& bytes) {
    spit(folder / "x.ply", bytes);
    const std::string message = message_of<DataError>([&] { PlyReader file(folder / "x.ply"); });
    EXPECT_CONTAINS(message, "x.ply");
    return message;
}

constexpr const char* kStart = "ply\nformat binary_little_endian 1.0\n";

TEST(PlyFile, ReadsEveryTypeAndIgnoresWhatFollows) {
    const TempFolder folder;
    std::string rows;
    const auto put = [&](auto v) { rows.append(reinterpret_cast<const char*>(&v), sizeof v); };
    for (int i = 0; i < 2; ++i) {
        put(std::int8_t(-3 - i)), put(std::uint8_t(200)), put(std::int16_t(-300)), put(std::uint16_t(60000));
        put(std::int32_t(-70000)), put(std::uint32_t(4000000000u)), put(1.5f), put(0.1 + i);
    }
    spit(folder / "a.ply",
         std::string(
             "ply\r\nformat binary_little_endian 1.0\r\ncomment hello world\r\nobj_info x\r\nelement vertex 2\r\n") +
             "property char a\nproperty uint8 b\nproperty short c\nproperty uint16 d\nproperty int e\nproperty uint32 "
             "f\n"
             "property float32 g\nproperty double h\nelement face 1\nproperty list uchar int "
             "vertex_indices\nend_header\n" +
             rows + "faces");
    PlyReader file(folder / "a.ply");
    EXPECT_EQ(file.header().comments, std::vector<std::string>{"hello world"});
    EXPECT_EQ(file.find("nothing"), -1);
    EXPECT_CONTAINS(message_of<DataError>([&] { file.require("nothing"); }), "'nothing' is missing");
    ASSERT_EQ(file.next_chunk(), 2);
    const double expected[] = {-4, 200, -300, 60000, -70000, 4000000000.0, 1.5, 1.1};
    for (int k = 0; k < 8; ++k) EXPECT_EQ(file.value(1, k), expected[k]) << k;
    EXPECT_EQ(file.next_chunk(), 0);
}

/// Two vertices (x, y, z, red) in the middle of what else a PLY may hold, in the given format.
std::string busy_file(const std::string& format) {
    const bool text = format == "ascii", swapped = format == "binary_big_endian";
    std::string rows;
    const auto put = [&](auto value) {
        if (text) {
            rows += std::to_string(value) + " ";
            return;
        }
        std::string bytes(reinterpret_cast<const char*>(&value), sizeof value);
        rows += swapped ? std::string(bytes.rbegin(), bytes.rend()) : bytes;
    };
    const auto end_row = [&] { rows += text ? "\r\n" : ""; };
    put(3.5f), put(std::uint8_t(2)), put(std::int16_t(7)), put(std::int16_t(8)), end_row();  // a camera
    for (int i = 0; i < 2; ++i) {
        put(1.25 + i), put(-2.0f), put(std::uint8_t(1)), put(std::int32_t(9)), put(std::int16_t(-300 - i));
        put(std::uint8_t(250)), end_row();
    }
    put(std::uint8_t(3)), put(std::int32_t(0)), put(std::int32_t(1)), put(std::int32_t(1)), end_row();  // a face
    return "ply\r\nformat " + format +
           " 1.0\r\ncomment hello\r\nobj_info x\r\nelement camera 1\r\nproperty float focal\r\n"
           "property list uchar short pixels\r\nelement vertex 2\r\nproperty double x\r\nproperty float32 y\r\n"
           "property list uchar int tracks\r\nproperty short z\r\nproperty uint8 red\r\nelement face 1\r\n"
           "property list uchar int vertex_indices\r\nend_header\r\n" +
           rows;
}

TEST(PlyFile, ThreeFormatsGiveTheSameVerticesAndSkipListsAndOtherElements) {
    const TempFolder folder;
    for (const char* format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
        spit(folder / "a.ply", busy_file(format));
        PlyReader file(folder / "a.ply");
        EXPECT_EQ(file.find("tracks"), -1) << "a list is no value";
        ASSERT_EQ(file.next_chunk(), 2) << format;
        const double expected[] = {2.25, -2, -301, 250};
        const char* names[] = {"x", "y", "z", "red"};
        for (int k = 0; k < 4; ++k) EXPECT_EQ(file.value(1, file.require(names[k])), expected[k]) << format;
        EXPECT_EQ(file.next_chunk(), 0);
    }
}

TEST(PlyFile, BigEndianRowsWithoutListsAreSwapped) {
    const TempFolder folder;
    spit(folder / "a.ply",
         "ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty ushort a\nproperty uint b\n"
         "end_header\n" +
             std::string("\x01\x02\0\0\x01\0\0\x03\0\0\0\x04", 12));
    PlyReader file(folder / "a.ply");
    ASSERT_EQ(file.next_chunk(), 2);
    EXPECT_EQ(file.value(0, 0), 258);
    EXPECT_EQ(file.value(0, 1), 256);
    EXPECT_EQ(file.value(1, 0), 3);
    EXPECT_EQ(file.value(1, 1), 4);
}

TEST(PlyFile, TextRowsAreNumbersInAnyNotationAndBlankLinesDoNotCount) {
    const TempFolder folder;
    const std::string head =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty uchar b\nend_header\n";
    spit(folder / "a.ply", head + "+1e-3 255.0\n\n\t-.5\t1\r\n 1.#QNAN   2");
    PlyReader file(folder / "a.ply");
    ASSERT_EQ(file.next_chunk(), 3);
    EXPECT_EQ(file.value(0, 0), 1e-3);
    EXPECT_EQ(file.value(0, 1), 255);
    EXPECT_EQ(file.value(1, 0), -0.5);
    EXPECT_TRUE(std::isnan(file.value(2, 0)));
    const auto error_of_rows = [&](const std::string& rows) {
        spit(folder / "b.ply", head + rows);
        PlyReader damaged(folder / "b.ply");
        return message_of<DataError>([&] { damaged.next_chunk(); });
    };
    EXPECT_CONTAINS(error_of_rows("1.5 2\n3\n4 5\n"), "vertex 1 has fewer numbers than the header says: '3'");
    EXPECT_CONTAINS(error_of_rows("1 2\n3 4 5\n6 7\n"), "vertex 1 has more numbers");
    EXPECT_CONTAINS(error_of_rows("1 2\n0,5 4\n6 7\n"), "vertex 1: '0,5' is not a number");
    EXPECT_CONTAINS(error_of_rows("1.0000 2.0000\n3 4\n"), "after 2 of 3 vertices");
}

TEST(PlyFile, SharedValuesFollowTheVerticesInEveryFormat) {
    const TempFolder folder;
    const std::string rest =
        " 1.0\nelement vertex 1\nproperty uchar x\nelement shared 2\nproperty float value\nend_header\n";
    spit(folder / "text.ply", "ply\nformat ascii" + rest + "7\n0.5\n-2\n");
    spit(folder / "big.ply", "ply\nformat binary_big_endian" + rest + std::string("\x07\x3f\0\0\0\xc0\0\0\0", 9));
    for (const char* name : {"text.ply", "big.ply"}) {
        PlyReader file(folder / name);
        ASSERT_EQ(file.next_chunk(), 1);
        EXPECT_EQ(file.value(0, 0), 7);
        EXPECT_EQ(file.read_shared(), (std::vector<float>{0.5f, -2.0f})) << name;
    }
}

TEST(PlyFile, HeaderWritesAndReadsBack) {
    const TempFolder folder;
    std::ostringstream out;
    write_ply_header(out, {{"one", "two"}, 0, {{"x", PlyType::kFloat}, {"red", PlyType::kUint8}}});
    EXPECT_EQ(out.str(),
              std::string(kStart) +
                  "comment one\ncomment two\nelement vertex 0\nproperty float x\nproperty uchar red\nend_header\n");
    spit(folder / "a.ply", out.str());
    PlyReader file(folder / "a.ply");
    EXPECT_EQ(file.header().properties.size(), 2u);
    EXPECT_EQ(file.next_chunk(), 0);
}

TEST(PlyFile, DamagedHeadersAreNamedErrors) {
    const TempFolder folder;
    EXPECT_CONTAINS(read_error(folder, ""), "end_header");
    EXPECT_CONTAINS(read_error(folder, "PNG\n"), "'ply'");
    EXPECT_CONTAINS(read_error(folder, std::string(100000, 'a')), "too long");
    EXPECT_CONTAINS(read_error(folder, "ply\nformat binary 1.0\nend_header\n"), "format 'binary' is not one of");
    EXPECT_CONTAINS(read_error(folder, "ply\nformat ascii 1.0\nelement vertex 9\nproperty int x\nend_header\n1\n2\n"),
                    "truncated");
    EXPECT_CONTAINS(read_error(folder, "ply\nend_header\n"), "format");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "end_header\n"), "no vertices");
    EXPECT_CONTAINS(
        read_error(folder, std::string(kStart) + "element face 2\nproperty list uchar int i\nelement vertex 1\n"
                                                 "property char x\nend_header\n\x01"),
        "'element face 2' needs 1 bytes each");
    EXPECT_CONTAINS(
        read_error(folder, std::string(kStart) + "element face 1\nproperty list uchar int i\nelement vertex 1\n"
                                                 "property char x\nend_header\n\x09"),
        "within the element face");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex -2\n"), "vertex count");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex 99999999999999999999\n"), "vertex count");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex 1 2\n"), "vertex count");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex 0x10\n"), "vertex count");
    EXPECT_CONTAINS(
        read_error(folder, std::string(kStart) + "element vertex 1\nproperty list uchar int i\nend_header\n"),
        "no vertices");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex 1\nproperty half x\nend_header\n"),
                    "half");
    EXPECT_CONTAINS(
        read_error(folder, std::string(kStart) + "element vertex 1\nproperty float x\nproperty float x\nend_header\n"),
        "twice");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex 1\nproperty float x\n"), "end_header");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex 2\nproperty float x\nend_header\n1234567"),
                    "truncated");
    EXPECT_CONTAINS(
        read_error(folder,
                   std::string(kStart) +
                       "element vertex 1152921504606846976\nproperty double x\nproperty double y\nend_header\n1234567"),
        "truncated");
    EXPECT_CONTAINS(message_of<DataError>([&] { PlyReader file(folder / "absent.ply"); }), "No such file");
    EXPECT_CONTAINS(message_of<DataError>([&] { PlyReader file(folder.path()); }), "it is a folder");
}

}  // namespace
}  // namespace gs::test
