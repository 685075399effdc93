// SPDX-License-Identifier: Apache-2.0
// What pictures show: depths as colours, who has a residual, sizes, and the frames of a folder.
#include "apps/gsapp/render/false_colors.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "apps/gsapp/render/camera_path.h"
#include "apps/gsapp/render/frame_folder.h"
#include "kernels/base/error.h"
#include "lib/core/json_text.h"
#include "lib/io/atomic_file.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/tiny_run.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Names = std::vector<std::string>;

TEST(DepthColors, RangeLeavesOutWhatFloats) {
    DepthRangeFinder finder;
    EXPECT_EQ(finder.range().far, 0);
    std::vector<float> depth(1000), alpha(1000, 1.0f);
    for (int i = 0; i < 1000; ++i) depth[std::size_t(i)] = 2 + 0.001f * float(i);
    depth[3] = 0.2f, depth[4] = 900;
    depth[5] = 50, alpha[5] = 0.4f;  // hardly there
    finder.add(depth, alpha);
    EXPECT_NEAR(finder.range().near, 2.01, 0.005);
    EXPECT_NEAR(finder.range().far, 2.99, 0.005);
    finder.add({7}, {1});
    EXPECT_EQ(finder.range().far, 7) << "the range is that of all pictures";
    EXPECT_NEAR(finder.range().near, 2.01, 0.005);
    finder.add({0, 0.1f}, {0, 0.2f});
    EXPECT_EQ(finder.range().far, 7);
}

TEST(DepthColors, GoFromYellowToPurple) {
    const std::vector<float> depth = {0, 1, 2, 3, 0.5f, 9};
    const Image image = colored_depth(depth, 3, 2, {1, 3});
    const auto pixel = [&](int x, int y) {
        const std::uint8_t* p = &image.u8[std::size_t(3 * (3 * y + x))];
        return std::array<int, 3>{p[0], p[1], p[2]};
    };
    using Color = std::array<int, 3>;
    EXPECT_EQ(pixel(0, 0), (Color{0, 0, 0}));
    EXPECT_EQ(pixel(1, 0), (Color{253, 231, 37}));
    EXPECT_EQ(pixel(2, 0), (Color{33, 144, 140})) << "halfway";
    EXPECT_EQ(pixel(0, 1), (Color{68, 1, 84}));
    EXPECT_EQ(pixel(1, 1), pixel(1, 0)) << "nearer than near";
    EXPECT_EQ(pixel(2, 1), pixel(0, 1));
    // One depth alone, and no range at all.
    EXPECT_EQ(colored_depth({2}, 1, 1, {2, 2}).u8.size(), 3u);
    EXPECT_EQ(colored_depth({0}, 1, 1, {}).u8, (std::vector<std::uint8_t>{0, 0, 0}));
}

TEST(DepthColors, RangeIsStatedInJson) {
    const auto json = parse_json(depth_range_text({1.5, 20}, DepthKind::kExpected));
    EXPECT_EQ(json["near"], 1.5);
    EXPECT_EQ(json["far"], 20);
    EXPECT_NE(json["values"].get<std::string>().find("expected"), std::string::npos);
    const auto median = parse_json(depth_range_text({1.5, 20}, DepthKind::kMedian));
    EXPECT_NE(median["values"].get<std::string>().find("median"), std::string::npos);
}

// The colours that show who has a residual.

std::vector<float> color_of(const Gaussians& g) {
    return appearance_colors(g, std::vector<View>(1))[Group::kBase].param;
}

TEST(AppearanceColors, GoFromGreyThroughBlueToYellow) {
    Gaussians g = test::one_sh_gaussian(0.0f);
    g.active_degree = 1;
    const std::vector<float> grey = {-0.25f, -0.25f, -0.25f}, blue = {-0.4f, -0.2f, 0.4f};
    const auto expect_near = [](const std::vector<float>& a, const std::vector<float>& b) {
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[std::size_t(c)], b[std::size_t(c)], 1e-6) << c;
    };
    expect_near(color_of(g), blue);
    for (float& x : g[Group::kResidual].param) x = 5;
    const std::vector<float> much = color_of(g);
    EXPECT_GT(much[0], much[2]) << "yellow";
    g[Group::kResidual].param.clear();
    expect_near(color_of(g), grey);
    EXPECT_EQ(appearance_colors(g, {})[Group::kMean].param, g[Group::kMean].param);
    EXPECT_EQ(appearance_colors(Gaussians{}, {}).count, 0);
}

// Sizes of pictures, and what a camera sees in another size.

TEST(PictureSize, ReadsWhatAPictureCanHave) {
    const PictureSize size = parse_picture_size("1280x720");
    EXPECT_EQ(size.width, 1280);
    EXPECT_EQ(size.height, 720);
    EXPECT_EQ(parse_picture_size("1x1").height, 1);
    EXPECT_EQ(parse_picture_size("8192x4096").width, 8192) << "2^25 pixels";
    EXPECT_EQ(parse_picture_size("32768x1024").width, 32768);
    for (const char* text : {"", "1280", "1280x", "x720", "0x720", "1280x0", "-1280x720", "1280x720x3", "1280X720",
                             "1280 x 720", "1e3x720", "nanx720", "8192x4097", "32769x1", "99999999999x1", "12.5x10"})
        EXPECT_THROW(parse_picture_size(text), UsageError) << text;
    EXPECT_FALSE(picture_size(std::nan(""), 10));
    EXPECT_FALSE(picture_size(10, 10.5));
}

TEST(PictureSize, KeepsTheVerticalFieldOfView) {
    Camera camera;
    camera.width = 40, camera.height = 30, camera.fx = 50, camera.fy = 60, camera.cx = 22, camera.cy = 14;
    const Camera wide = with_vertical_field(camera, {160, 60});
    EXPECT_EQ(wide.width, 160);
    EXPECT_EQ(wide.height, 60);
    EXPECT_DOUBLE_EQ(wide.height / wide.fy, camera.height / camera.fy);
    EXPECT_DOUBLE_EQ(wide.fx / wide.fy, camera.fx / camera.fy) << "pixels keep their shape";
    EXPECT_DOUBLE_EQ(wide.cy, 28);
    EXPECT_DOUBLE_EQ(wide.cx, 80 + 2 * 2) << "two pixels right of the middle, in pixels half as large";
    const Camera same = with_vertical_field(camera, {40, 30});
    EXPECT_EQ(same.fx, camera.fx);
    EXPECT_EQ(same.cx, camera.cx);
}

// A folder of frames holds those of one call.

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
