// SPDX-License-Identifier: Apache-2.0
// The PLY container: property types, order, and headers that cannot be trusted.
#include "lib/io/ply_file.h"

#include <sstream>

#include "kernels/core/error.h"
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
    EXPECT_CONTAINS(read_error(folder, "ply\nformat ascii 1.0\nend_header\n"), "ascii");
    EXPECT_CONTAINS(read_error(folder, "ply\nend_header\n"), "format");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "end_header\n"), "no vertices");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element face 2\n"), "'face'");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex -2\n"), "vertex count");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex 99999999999999999999\n"), "vertex count");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex 1 2\n"), "vertex count");
    EXPECT_CONTAINS(read_error(folder, std::string(kStart) + "element vertex 0x10\n"), "vertex count");
    EXPECT_CONTAINS(
        read_error(folder, std::string(kStart) + "element vertex 1\nproperty list uchar int i\nend_header\n"), "list");
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
