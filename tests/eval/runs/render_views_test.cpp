// SPDX-License-Identifier: Apache-2.0
// Which views are rendered, and where their pictures go.
#include "apps/gsapp/render/render_views.h"

#include <gtest/gtest.h>

#include "lib/model/ply.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/tiny_run.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

namespace fs = std::filesystem;

/// What is below the folder, sorted.
std::vector<std::string> files_in(const fs::path& folder) {
    std::vector<std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        if (!entry.is_directory()) files.push_back(entry.path().lexically_relative(folder));
    std::sort(files.begin(), files.end());
    return files;
}

TEST(RenderViews, ViewsAreOneKindOrCameras) {
    Scene scene;
    scene.test.resize(1), scene.train.resize(2);
    scene.test[0].name = "held out";
    EXPECT_EQ(views_of(scene, "test")[0].name, "held out");
    EXPECT_EQ(views_of(scene, "train").size(), 2u);
    std::vector<Camera> cameras(2);
    cameras[1].width = 7;
    EXPECT_EQ(views_of(cameras)[1].camera.width, 7);
}

TEST(RenderViews, WritesPicturesAndTheirParts) {
    const test::TinyRun saved;
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    std::vector<View> views = run.scene.test;
    views.resize(2);
    const auto folder = saved.folder.path() / "pictures";
    render_views(run, views, run.correction, {}, folder);
    EXPECT_EQ(files_in(folder), (std::vector<std::string>{"00000.png", "00001.png"}));
    const Image picture = read_image(folder / "00001.png");
    EXPECT_GT(picture.value(20, 14, 0), 0.5f) << "the red Gaussian is in the middle";
    EXPECT_GT(picture.value(0, 0, 2), 0.99f) << "before the run's background";
    const auto parts = saved.folder.path() / "parts";
    render_views(run, views, run.correction, {.decompose = true}, parts);
    for (const char* part : {"full", "base", "residual"}) EXPECT_TRUE(fs::exists(parts / part / "00001.png")) << part;
    EXPECT_EQ(read_image(parts / "residual" / "00001.png").value(20, 14, 0), 0) << "the model has no residual";
}

TEST(RenderViews, WritesDepthNormalsAndAlphaBesidePictures) {
    const test::TinyRun saved;
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    std::vector<View> views = run.scene.test;
    views.resize(2);
    for (const bool decompose : {false, true}) {
        const RenderParts parts = {decompose, true, true, true, true};
        const auto folder = saved.folder.path() / (decompose ? "decomposed" : "plain");
        render_views(run, views, run.correction, parts, folder);
        std::vector<std::string> expected = render_files(parts, 2);
        std::sort(expected.begin(), expected.end());
        EXPECT_EQ(files_in(folder), expected);
        EXPECT_EQ(expected.size(), decompose ? 24u : 20u);
        const Camera& camera = views[1].camera;
        const double z = (camera.rotation * Eigen::Vector3d(0, 0, 0.3) + camera.translation).z();
        EXPECT_NEAR(read_image(folder / "depth/00001.exr").value(20, 14, 0), z, 1e-5);
        EXPECT_EQ(read_image(folder / "depth/00001.exr").value(0, 0, 0), 0) << "whatever the background is";
        EXPECT_EQ(read_image(folder / "depth/00001.png").value(0, 0, 0), 0);
        EXPECT_GT(read_image(folder / "depth/00001.png").value(20, 14, 1), 0);
        EXPECT_NEAR(read_image(folder / "median_depth/00001.exr").value(20, 14, 0), z, 1e-5);
        EXPECT_EQ(read_image(folder / "median_depth/00001.exr").value(0, 0, 0), 0);
        EXPECT_GT(read_image(folder / "median_depth/00001.png").value(20, 14, 1), 0);
        EXPECT_GT(read_image(folder / "alpha/00001.exr").value(20, 14, 0), 0.9f);
        EXPECT_EQ(read_image(folder / "alpha/00001.exr").value(0, 0, 0), 0);
        EXPECT_GT(read_image(folder / "alpha/00001.png").value(20, 14, 0), 0.9f);
        const Image normals = read_image(folder / "normals/00001.exr");
        const Eigen::Vector3d n(normals.value(20, 14, 0), normals.value(20, 14, 1), normals.value(20, 14, 2));
        EXPECT_NEAR(n.norm(), 1, 1e-5);
        EXPECT_GT(n.dot(camera.center() - Eigen::Vector3d(0, 0, 0.3)), 0) << "towards the camera";
    }
}

TEST(RenderViews, AnEmptyModelIsBackgroundWithAlphaZero) {
    const test::TinyRun saved;
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    Gaussians empty = run.backend->download(false);
    empty.count = 0;
    for (auto& group : empty.groups) group.param.clear();
    run.backend->upload(empty);
    std::vector<View> views = run.scene.test;
    views.resize(2);
    views[1].camera.width = views[1].camera.height = 1;
    const auto folder = saved.folder.path() / "empty";
    render_views(run, views, run.correction, {false, true, true, true, true}, folder);
    for (const char* part : {"alpha", "depth", "median_depth", "normals"})
        for (const char* frame : {"00000", "00001"})
            for (const char* extension : {"exr", "png"}) {
                const Image image = read_image(folder / part / (std::string(frame) + "." + extension));
                for (int y = 0; y < image.height; ++y)
                    for (int x = 0; x < image.width; ++x) ASSERT_EQ(image.value(x, y, 0), 0) << part << frame;
            }
    EXPECT_EQ(read_image(folder / "00001.png").width, 1);
    EXPECT_EQ(read_image(folder / "00001.png").value(0, 0, 2), 1) << "the run's background is blue";
}

// A PLY file rendered through the backend against the renderer without tiles.

TEST(PlyRender, EqualsBruteForceToTheTruncationBound) {
    const TemporaryFolder folder;
    for (const int degree : {0, 1, 2, 3}) {
        const GaussianState<double> scene = random_gaussians(150, degree, 40 + std::uint32_t(degree));
        Gaussians stored = cast<float>(scene);
        stored.appearance.model = degree ? "sh" : "none";
        const auto path = folder.path() / ("degree" + std::to_string(degree) + ".ply");
        write_ply(path, stored, {});
        const auto backend = make_cpu_backend(read_ply(path).appearance);
        backend->upload(read_ply(path));

        const int width = 61, height = 47;
        RenderRequest request;
        request.camera = cast<float>(test_camera(width, height));
        request.background = {0.25f, 0.5f, 0.75f};
        RenderedImage image;
        backend->render(request, image);

        const BruteForce brute(scene, test_camera(width, height));
        const double max_color = std::max(1.0, brute.max_color());
        double worst = 0, worst_same = 0;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const std::size_t i = std::size_t(y) * width + x, plane = std::size_t(width) * height;
                const auto error = [&](const BruteForcePixel& p) {
                    return std::max({std::abs(image.rgb[i] - p.color.x), std::abs(image.rgb[i + plane] - p.color.y),
                                     std::abs(image.rgb[i + 2 * plane] - p.color.z)});
                };
                // Leaving out a fragment changes a pixel by at most alpha times the largest colour, stopping at
                // T < 1e-4 by that much of it; 5e-5 is for parameters and arithmetic in float.
                const Vec3<double> background{0.25, 0.5, 0.75};
                const BruteForcePixel exact = brute.pixel(x, y, background, false);
                const double bound = (exact.dropped_alpha + 1e-4) * max_color + 5e-5;
                EXPECT_LE(error(exact), bound) << x << "," << y;
                worst = std::max(worst, error(exact) / bound);
                const BruteForcePixel same = brute.pixel(x, y, background, true);
                if (same.threshold_distance > 1e-3) worst_same = std::max(worst_same, error(same));
            }
        EXPECT_LE(worst_same, 5e-5);
        std::printf("degree %d: %.0f %% of the bound; with the same truncation %.1e\n", degree, 100 * worst,
                    worst_same);
    }
}

}  // namespace
}  // namespace gs::test
