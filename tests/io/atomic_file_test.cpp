// SPDX-License-Identifier: Apache-2.0
// Files appear completely or not at all, also when the disk refuses.
#include "lib/io/atomic_file.h"

#include <unistd.h>

#include "kernels/base/error.h"
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

}  // namespace
}  // namespace gs::test
