// SPDX-License-Identifier: Apache-2.0
// One run at a time in a folder, and none in a folder that is gone.
#include "lib/model/run_folder.h"

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

#include "kernels/base/error.h"
#include "tests/io/file_helpers.h"

namespace gs::test {
namespace {

namespace fs = std::filesystem;

TEST(RunLock, SecondRunIsRefusedAndTold) {
    const TempFolder folder;
    const fs::path run = folder / "a/run";
    {
        const RunLock lock(run);
        const std::string message = message_of<UsageError>([&] { RunLock second(run); });
        EXPECT_CONTAINS(message, run.string());
        EXPECT_CONTAINS(message, "(process " + std::to_string(::getpid()) + ")");
        lock.check_folder();
    }
    EXPECT_TRUE(fs::is_empty(run));
    const RunLock again(run);
}

TEST(RunLock, KilledRunLeavesNoLockBehind) {
    const TempFolder folder;
    int ready[2];
    ASSERT_EQ(::pipe(ready), 0);
    const pid_t child = ::fork();
    if (child == 0) {
        const RunLock lock(folder.path());
        if (::write(ready[1], "x", 1) != 1) ::_exit(1);
        ::pause();
        ::_exit(1);
    }
    char byte = 0;
    ASSERT_EQ(::read(ready[0], &byte, 1), 1);
    EXPECT_CONTAINS(message_of<UsageError>([&] { RunLock second(folder.path()); }),
                    "(process " + std::to_string(child) + ")");
    ::kill(child, SIGKILL);
    ASSERT_EQ(::waitpid(child, nullptr, 0), child);
    EXPECT_FALSE(fs::is_empty(folder.path())) << "the file stays";
    const RunLock lock(folder.path());
    ::close(ready[0]), ::close(ready[1]);
}

TEST(RunLock, NoticesThatTheFolderIsGone) {
    const TempFolder folder;
    const fs::path run = folder / "run", moved = folder / "moved";
    const RunLock lock(run);
    fs::rename(run, moved);
    EXPECT_CONTAINS(message_of<DataError>([&] { lock.check_folder(); }), run.string());
    fs::create_directory(run);
    EXPECT_CONTAINS(message_of<DataError>([&] { lock.check_folder(); }), "removed or replaced");
    fs::remove(run);
    fs::rename(moved, run);
    lock.check_folder();
}

TEST(RunLock, FolderThatCannotBeMadeIsADataError) {
    const TempFolder folder;
    spit(folder / "plain", "x");
    EXPECT_CONTAINS(message_of<DataError>([&] { RunLock lock(folder / "plain/run"); }), "plain/run");
    EXPECT_CONTAINS(message_of<DataError>([&] { RunLock lock(folder / "plain"); }), "plain");
}

}  // namespace
}  // namespace gs::test
