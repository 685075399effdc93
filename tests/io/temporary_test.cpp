// SPDX-License-Identifier: Apache-2.0
// Temporary files of killed programs go; those of living ones, and what only looks like one, stay.
#include "lib/io/temporary.h"

#include <sys/stat.h>

#include <algorithm>

#include "lib/io/atomic_file.h"
#include "tests/io/file_helpers.h"
#include "tests/io/limits.h"

namespace gs::test {
namespace {

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

}  // namespace
}  // namespace gs::test
