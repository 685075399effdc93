// SPDX-License-Identifier: Apache-2.0
// Only regular files are read, and the reason of a refusal is the true one.
#include "lib/core/input_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "kernels/base/error.h"
#include "tests/core/temporary_folder.h"
#include "tests/core/unprivileged.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

template <class F> std::string data_error(F&& f) {
    try {
        f();
    } catch (const DataError& e) {
        return e.what();
    }
    return "no DataError";
}

void expect_names(const std::string& message, const fs::path& path, const std::string& reason) {
    EXPECT_NE(message.find(path.string()), std::string::npos) << message;
    EXPECT_NE(message.find(reason), std::string::npos) << message;
}

TEST(InputFile, RegularFilesAreReadWhole) {
    const TemporaryFolder folder;
    const std::string text("a\0b\r\n", 5);
    EXPECT_EQ(read_input(folder.write("a", text)), text);
    EXPECT_EQ(read_input(folder.write("empty", "")), "");
    EXPECT_EQ(input_fault(folder.path() / "a"), "");
    fs::create_symlink("a", folder.path() / "link");
    EXPECT_EQ(read_input(folder.path() / "link"), text);
}

TEST(InputFile, ErrorsOfReadingAreNeitherAnEmptyFileNorAnEnd) {
    // The kernel reads nothing at address 0 of a process and answers EIO, as a disk does that fails.
    expect_names(data_error([&] { read_input("/proc/self/mem"); }), "/proc/self/mem", "Input/output error");
}

TEST(InputFile, FilesWhoseSizeIsNotStatedAreReadToTheirEnd) {
    EXPECT_NE(read_input("/proc/self/status").find("VmPeak"), std::string::npos);
}

TEST(InputFile, PipesDevicesAndFoldersAreRefusedWithoutWaiting) {
    const TemporaryFolder folder;
    const fs::path pipe = folder.path() / "pipe";
    ASSERT_EQ(::mkfifo(pipe.c_str(), 0666), 0);
    expect_names(data_error([&] { open_input(pipe); }), pipe, "named pipe (FIFO)");
    expect_names(data_error([&] { read_input("/dev/zero"); }), "/dev/zero", "a device");
    expect_names(data_error([&] { read_input(folder.path()); }), folder.path(), "a folder");
    fs::create_symlink(pipe, folder.path() / "link");
    expect_names(data_error([&] { read_input(folder.path() / "link"); }), "link", "named pipe (FIFO)");
}

TEST(InputFile, AnswersThatAreNoneAreErrorsWithTheirReason) {
    const TemporaryFolder folder;
    const fs::path loop = folder.path() / "loop", long_name = folder.path() / std::string(300, 'x');
    fs::create_symlink("loop", loop);
    EXPECT_FALSE(path_exists(folder.path() / "absent"));
    EXPECT_FALSE(folder_exists(folder.path() / "absent"));
    EXPECT_FALSE(path_exists(folder.write("file", "") / "below"));
    EXPECT_TRUE(folder_exists(folder.path()));
    expect_names(data_error([&] { read_input(folder.path() / "absent"); }), "absent", "No such file");
    for (const auto& [path, reason] :
         {std::pair(loop, "Too many levels"), std::pair(long_name, "File name too long")}) {
        expect_names(data_error([&] { path_exists(path); }), path, reason);
        expect_names(data_error([&] { folder_exists(path); }), path, reason);
        expect_names(data_error([&] { list_folder(path); }), path, reason);
        expect_names(data_error([&] { read_input(path); }), path, reason);
        expect_names(data_error([&] { canonical_path(path / "below"); }), path, reason);
    }
}

TEST(InputFile, WhatMayNotBeReadIsNotMissing) {
    const TemporaryFolder folder;
    const fs::path closed = folder.path() / "closed", file = folder.write("file", "x");
    fs::create_directory(closed);
    fs::permissions(folder.path(), fs::perms(0755));
    for (const fs::path& path : {closed, file}) fs::permissions(path, fs::perms::none);
    {
        const test::Unprivileged nobody;
        if (!nobody.bound()) GTEST_SKIP() << "root is bound by no permissions";
        expect_names(data_error([&] { list_folder(closed); }), closed, "Permission denied");
        expect_names(data_error([&] { path_exists(closed / "a"); }), closed, "Permission denied");
        expect_names(data_error([&] { read_input(file); }), file, "Permission denied");
    }
    fs::permissions(closed, fs::perms::owner_all);
}

}  // namespace
}  // namespace gs
