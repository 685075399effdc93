// SPDX-License-Identifier: Apache-2.0
// A folder of frames holds those of one call.
#include "apps/gsapp/render/frame_folder.h"

#include <gtest/gtest.h>

#include "kernels/base/error.h"
#include "lib/io/atomic_file.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Names = std::vector<std::string>;

/// What is in the folder, with hidden files and all below.
Names contents(const fs::path& folder) {
    Names names;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        if (!entry.is_directory() || fs::is_empty(entry)) names.push_back(entry.path().lexically_relative(folder));
    std::sort(names.begin(), names.end());
    return names;
}

void write(const fs::path& folder, const Names& names, bool overwrite = false, const char* text = "x") {
    FrameFolder frames(folder, names, overwrite);
    for (const std::string& name : names) write_text_atomic(frames.path() / name, text);
    frames.commit();
}

std::string read(const fs::path& path) {
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), {}};
}

TEST(FrameFolder, IsReplacedAsAWhole) {
    const test::TemporaryFolder temporary;
    const fs::path folder = temporary.path() / "new" / "frames";
    const Names three = {"00000.png", "00001.png", "00002.png"}, two = {"00000.png", "00001.png"};
    write(folder, two);
    EXPECT_EQ(contents(folder), two);
    write(folder, three, false, "later");  // all that was there is replaced
    EXPECT_EQ(contents(folder), three);
    EXPECT_EQ(read(folder / "00001.png"), "later");

    try {
        write(folder, two);
        ADD_FAILURE() << "the third frame would stay";
    } catch (const UsageError& e) {
        EXPECT_NE(std::string(e.what()).find("00002.png"), std::string::npos) << e.what();
        EXPECT_NE(std::string(e.what()).find("--overwrite"), std::string::npos) << e.what();
    }
    EXPECT_EQ(contents(folder), three);
    write(folder, two, true, "again");
    EXPECT_EQ(contents(folder), two);
    EXPECT_EQ(read(folder / "00000.png"), "again");
}

TEST(FrameFolder, KnowsPartsAndLeavesOtherFilesAlone) {
    const test::TemporaryFolder temporary;
    const fs::path folder = temporary.path();
    for (const char* mine : {"notes.txt", "1234.png", "000x1.png", "00001.jpg", "video.mp4"}) temporary.write(mine, "");
    fs::create_directory(folder / "mine");
    temporary.write("mine/00007.png", "");
    const Names before = contents(folder);
    write(folder, {"00000.png", "depth/00000.exr", "depth/00000.png", "depth/range.json", "median_depth/00000.png",
                   "median_depth/range.json"});
    EXPECT_THROW(write(folder, {"00000.png"}), UsageError) << "depths of another call would stay";
    EXPECT_THROW(write(folder, {"full/00000.png"}), UsageError);
    write(folder, {"full/00000.png"}, true);
    Names after = before;
    after.push_back("full/00000.png");
    std::sort(after.begin(), after.end());
    EXPECT_EQ(contents(folder), after) << "frames are gone, with their folders, and nothing else";
}

TEST(FrameFolder, StaysAsItWasWithoutCommit) {
    const test::TemporaryFolder temporary;
    const fs::path folder = temporary.path() / "frames";
    write(folder, {"00000.png", "00001.png"});
    {
        FrameFolder frames(folder, {"00000.png"}, true);
        write_text_atomic(frames.path() / "00000.png", "half");
    }
    EXPECT_EQ(contents(folder), (Names{"00000.png", "00001.png"}));
    EXPECT_EQ(read(folder / "00000.png"), "x");
    { FrameFolder frames(temporary.path() / "new" / "inner", {"00000.png"}, false); }
    EXPECT_FALSE(fs::exists(temporary.path() / "new")) << "nothing came of it";
    temporary.write("file", "");
    EXPECT_THROW(FrameFolder(temporary.path() / "file", {"00000.png"}, false), DataError);
}

}  // namespace
}  // namespace gs
