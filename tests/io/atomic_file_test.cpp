// SPDX-License-Identifier: Apache-2.0
// Files appear completely or not at all, also when the disk refuses.
#include "lib/io/atomic_file.h"

#include <sys/stat.h>
#include <unistd.h>
#include <algorithm>

#include "kernels/base/error.h"
#include "lib/io/event_file.h"
#include "lib/io/temporary.h"
#include "tests/io/file_helpers.h"
#include "tests/io/limits.h"

namespace gs::test {
namespace {

TEST(AtomicFile, TargetAppearsOnlyAtCommit) {
    const TempFolder folder;
    AtomicFile file(folder / "a.bin");
    file.stream() << "hello " << 42;
    file.stream().flush();
    EXPECT_FALSE(std::filesystem::exists(folder / "a.bin"));
    file.commit();
    EXPECT_EQ(slurp(folder / "a.bin"), "hello 42");
    EXPECT_EQ(folder.num_entries(), 1u);
}

TEST(AtomicFile, DestructionWithoutCommitKeepsTheOldFile) {
    const TempFolder folder;
    write_text_atomic(folder / "a.txt", "old");
    { AtomicFile(folder / "a.txt").stream() << "new"; }
    EXPECT_EQ(slurp(folder / "a.txt"), "old");
    EXPECT_EQ(folder.num_entries(), 1u);
}

TEST(AtomicFile, LargeAndSmallWritesKeepTheirOrder) {
    const TempFolder folder;
    std::string expected;
    AtomicFile file(folder / "sub/deep/a.bin");
    for (int i = 0; i < 300; ++i) {
        const std::string part(std::size_t(i) * 41 % 7919 * (i % 50 == 0 ? 200 : 1), char('a' + i % 26));
        file.stream() << part;
        file.stream().put('|');
        expected += part + "|";
    }
    file.commit();
    EXPECT_EQ(slurp(folder / "sub/deep/a.bin"), expected);
}

TEST(AtomicFile, CopiesAreWhole) {
    const TempFolder folder;
    const std::string bytes(700000, 'x');
    spit(folder / "a.bin", bytes);
    spit(folder / "empty", "");
    copy_file_atomic(folder / "a.bin", folder / "sub/b.bin");
    copy_file_atomic(folder / "empty", folder / "sub/empty");
    EXPECT_EQ(slurp(folder / "sub/b.bin"), bytes);
    EXPECT_TRUE(std::filesystem::exists(folder / "sub/empty"));
    EXPECT_CONTAINS(message_of<DataError>([&] { copy_file_atomic(folder / "none", folder / "sub/c"); }), "none");
    EXPECT_FALSE(std::filesystem::exists(folder / "sub/c"));
}

TEST(AtomicFile, FolderBelowARegularFileIsADataError) {
    const TempFolder folder;
    spit(folder / "plain", "x");
    const std::string message = message_of<DataError>([&] { AtomicFile(folder / "plain/a.txt"); });
    EXPECT_CONTAINS(message, "plain/a.txt");
    EXPECT_CONTAINS(message, "Not a directory");
}

TEST(AtomicFile, TargetThatIsAFolderIsADataErrorAndLeavesNothing) {
    const TempFolder folder;
    std::filesystem::create_directories(folder / "a/b");
    EXPECT_CONTAINS(message_of<DataError>([&] { write_text_atomic(folder / "a", "x"); }), "Is a directory");
    EXPECT_EQ(folder.num_entries(), 1u);
}

TEST(AtomicFile, ReadOnlyFolderIsADataError) {
    const TempFolder folder;
    using std::filesystem::perms;
    std::filesystem::permissions(folder.path(),
                                 perms::owner_read | perms::owner_exec | perms::others_read | perms::others_exec);
    const int status = in_child([&] {
        // root may write everywhere, so the child becomes somebody else.
        if (::geteuid() == 0 && ::seteuid(65534) != 0) return 3;
        return data_error_status([&] { write_text_atomic(folder / "a", "x"); }, "Permission denied", "/a'");
    });
    std::filesystem::permissions(folder.path(), perms::owner_all);
    EXPECT_EQ(status, 0);
    EXPECT_EQ(folder.num_entries(), 0u);
}

TEST(AtomicFile, FullDiskDuringALargeWriteLeavesTheOldFileAndNothingElse) {
    const TempFolder folder;
    write_text_atomic(folder / "a.bin", "old");
    const std::string block(3 << 20, 'x');
    const int status = in_child([&] {
        limit_file_size(1 << 20);
        return data_error_status(
            [&] {
                AtomicFile file(folder / "a.bin");
                file.stream().write(block.data(), std::streamsize(block.size()));
            },
            "a.bin", "File too large");
    });
    EXPECT_EQ(status, 0);
    EXPECT_EQ(slurp(folder / "a.bin"), "old");
    EXPECT_EQ(folder.num_entries(), 1u);
}

TEST(AtomicFile, FullDiskFoundOnlyAtCommitLeavesNothing) {
    const TempFolder folder;
    const int status = in_child([&] {
        limit_file_size(10);  // the text stays in the buffer until commit
        return data_error_status([&] { write_text_atomic(folder / "a.txt", "twelve bytes"); }, "a.txt",
                                 "File too large");
    });
    EXPECT_EQ(status, 0);
    EXPECT_EQ(folder.num_entries(), 0u);
}

// Temporary files of killed programs go; those of living ones, and what only looks like one, stay.

std::vector<std::string> names_in(const std::filesystem::path& folder) {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
}

TEST(Temporary, LeftoversOfAKilledProgramGo) {
    const TempFolder folder;
    const int status = in_child([&] {
        create_temporary_file(folder / "a.bin");
        spit((new WorkFolder(folder / "site"))->path() / "assets/b.js", "x");
        return 0;  // by _exit, as if it were killed
    });
    ASSERT_EQ(status, 0);
    ASSERT_EQ(folder.num_entries(), 2u);
    spit(folder / "site/kept.txt", "x");
    remove_leftovers(folder.path());
    EXPECT_EQ(names_in(folder.path()), std::vector<std::string>{"site"});
}

TEST(Temporary, WritingIntoAFolderRemovesItsLeftovers) {
    const TempFolder folder;
    in_child([&] {
        create_temporary_file(folder / "sub/a.bin");
        return 0;
    });
    ASSERT_EQ(names_in(folder / "sub").size(), 1u);
    write_text_atomic(folder / "sub/b.txt", "x");
    EXPECT_EQ(names_in(folder / "sub"), std::vector<std::string>{"b.txt"});
}

TEST(Temporary, FilesInWorkStay) {
    const TempFolder folder;
    AtomicFile file(folder / "a.txt");
    file.stream() << "new";
    {
        const WorkFolder work(folder / "site");
        remove_leftovers(folder.path());
        EXPECT_TRUE(std::filesystem::is_directory(work.path()));
    }
    file.commit();
    EXPECT_EQ(slurp(folder / "a.txt"), "new");
    EXPECT_EQ(folder.num_entries(), 1u);
}

TEST(Temporary, OtherFilesStay) {
    const TempFolder folder;
    const std::vector<std::string> names = {".a.12-0.tm", ".a.12.tmp",  ".a.1x-0.tmp", ".a.12-.tmp",     ".a.-0.tmp",
                                            ".12-0.tmp",  "..12-0.tmp", "a.12-0.tmp",  ".a.12-0.tmp.txt"};
    for (const std::string& name : names) spit(folder / name, "mine");
    spit(folder / "target", "x");
    std::filesystem::create_symlink("target", folder / ".link.12-0.tmp");
    ::mkfifo((folder / ".fifo.12-0.tmp").c_str(), 0600);
    remove_leftovers(folder.path());
    EXPECT_EQ(folder.num_entries(), names.size() + 3);
}

TEST(Temporary, FilesOfOtherUsersStay) {
    if (::geteuid() != 0) GTEST_SKIP() << "only root can make a file of another user";
    const TempFolder folder;
    spit(folder / ".a.12-0.tmp", "x");
    spit(folder / ".b.12-0.tmp", "x");
    ASSERT_EQ(::chown((folder / ".b.12-0.tmp").c_str(), 65534, 65534), 0);
    remove_leftovers(folder.path());
    EXPECT_EQ(names_in(folder.path()), std::vector<std::string>{".b.12-0.tmp"});
}

// Event files: checksums, names in order, and what a full disk leaves.

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
