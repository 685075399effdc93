// SPDX-License-Identifier: Apache-2.0
// Which views are rendered, and where their pictures go.
#include "eval/runs/render_views.h"

#include <gtest/gtest.h>

#include "tests/eval/support/tiny_run.h"

namespace gs {
namespace {

TEST(RenderViews, TestViewsComeFirst) {
    Scene scene;
    scene.test.resize(1), scene.train.resize(2);
    scene.test[0].name = "held out";
    EXPECT_EQ(views_of(scene, "test").size(), 1u);
    EXPECT_EQ(views_of(scene, "train").size(), 2u);
    ASSERT_EQ(views_of(scene, "all").size(), 3u);
    EXPECT_EQ(views_of(scene, "all")[0].name, "held out");
    std::vector<Camera> cameras(2);
    cameras[1].width = 7;
    EXPECT_EQ(views_of(cameras)[1].camera.width, 7);
}

TEST(RenderViews, WritesPicturesAndTheirParts) {
    const test::TinyRun saved;
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    std::vector<View> views = views_of(run.scene, "test");
    views.resize(2);
    const auto folder = saved.folder.path() / "pictures";
    render_views(run, views, run.correction, false, folder);
    const Image picture = read_image(folder / "00001.png");
    EXPECT_GT(picture.value(20, 14, 0), 0.5f) << "the red Gaussian is in the middle";
    EXPECT_GT(picture.value(0, 0, 2), 0.99f) << "before the run's background";
    EXPECT_FALSE(std::filesystem::exists(folder / "00002.png"));
    render_views(run, views, run.correction, true, folder);
    for (const char* part : {"full", "base", "residual"})
        EXPECT_TRUE(std::filesystem::exists(folder / part / "00001.png")) << part;
    EXPECT_EQ(read_image(folder / "residual" / "00001.png").value(20, 14, 0), 0) << "the model has no residual";
}

}  // namespace
}  // namespace gs
