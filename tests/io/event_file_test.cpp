// SPDX-License-Identifier: Apache-2.0
// Event files: checksums, names in order, and what a full disk leaves.
#include "lib/io/event_file.h"

#include <algorithm>

#include "tests/io/file_helpers.h"
#include "tests/io/limits.h"

namespace gs::test {
namespace {

TEST(Crc32c, HasTheValuesOfRfc3720) {
    EXPECT_EQ(crc32c(""), 0u);
    EXPECT_EQ(crc32c("123456789"), 0xE3069283u);
    EXPECT_EQ(crc32c(std::string(32, '\0')), 0x8A9136AAu);
    EXPECT_EQ(crc32c(std::string(32, '\xFF')), 0x62A8AB43u);
    std::string rising, falling;
    for (int k = 0; k < 32; ++k) rising += char(k), falling += char(31 - k);
    EXPECT_EQ(crc32c(rising), 0x46DD794Eu);
    EXPECT_EQ(crc32c(falling), 0x113FDB5Cu);
}

TEST(EventFile, NamesAreInTheOrderOfTheFiles) {
    const TempFolder folder;
    std::vector<std::string> names;
    for (int k = 0; k < 3; ++k) {  // within one second
        EventFile file(folder / "board");
        file.add(k, {{"a/b", 0.5}});
        names.push_back(file.path().filename());
        EXPECT_NE(names.back().find("tfevents"), std::string::npos);
    }
    EXPECT_TRUE(std::is_sorted(names.begin(), names.end()));
    EXPECT_NE(names[0], names[1]);
}

TEST(EventFile, WithoutEventsLeavesNothing) {
    const TempFolder folder;
    { const EventFile file(folder / "new"); }
    EXPECT_FALSE(std::filesystem::exists(folder / "new"));
    std::filesystem::create_directory(folder / "old");
    { const EventFile file(folder / "old"); }
    EXPECT_TRUE(std::filesystem::is_empty(folder / "old"));
}

TEST(EventFile, OfAFullDiskEndsWithAWholeRecord) {
    const TempFolder folder;
    const int status = in_child([&] {
        EventFile file(folder / "board");
        const std::size_t begin = slurp(file.path()).size();
        file.add(1, {{"a", 1}});
        const std::string whole = slurp(file.path());
        const std::size_t record = whole.size() - begin;
        limit_file_size(whole.size() + 20);
        const int refused = data_error_status([&] { file.add(2, {{"a", 2}}); }, "tfevents", "File too large");
        if (refused != 0 || slurp(file.path()) != whole) return 3;
        limit_file_size(1 << 20);
        file.add(3, {{"a", 3}});  // there is room again
        return slurp(file.path()).size() == whole.size() + record ? 0 : 4;
    });
    EXPECT_EQ(status, 0);
}

TEST(EventFile, ThatCannotBeBegunIsADataErrorAndLeavesNothing) {
    const TempFolder folder;
    const int status = in_child([&] {
        limit_file_size(10);
        return data_error_status([&] { EventFile file(folder / "board"); }, "board", "File too large");
    });
    EXPECT_EQ(status, 0);
    EXPECT_FALSE(std::filesystem::exists(folder / "board"));
    folder.write("file", "");
    EXPECT_THROW(EventFile(folder / "file"), DataError);
    EXPECT_THROW(EventFile(folder / "file/board"), DataError);
}

}  // namespace
}  // namespace gs::test
