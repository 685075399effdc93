// SPDX-License-Identifier: Apache-2.0
// Opening a run folder again, from its PLY and from its checkpoint.
#include "eval/runs/saved_run.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <functional>

#include "appearance/model_info.h"
#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/core/run_config.h"
#include "lib/export/ngsplat.h"
#include "lib/export/pack_scene.h"
#include "lib/io/atomic_file.h"
#include "lib/model/cameras_json.h"
#include "lib/model/checkpoint.h"
#include "lib/model/ply.h"
#include "lib/model/run_folder.h"
#include "lib/scene/scene.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/tiny_run.h"
#include "tests/kernels/backends.h"
#include "tests/model/model_helpers.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using test::one_gaussian;
using test::TempFolder;

struct RunOnDisk {
    test::TemporaryFolder folder;
    RunOnDisk() {
        TrainOptions options;
        options.source = "builtin:diffuse";
        options.model = folder.path();
        options.resolution = 40;
        options.eval = true;
        options.appearance = "none";
        options.background = {.color = {0, 0, 1}};
        options = resolve(options);
        folder.write("config.yaml", options_to_yaml(options));
    }
    RunFolder names() const { return {folder.path()}; }
};

TEST(SavedRun, OpensTheLastPointCloudAndItsScene) {
    const RunOnDisk saved;
    Gaussians other = one_gaussian();
    other[Group::kBase].param = {-0.5f, 0.4f, -0.5f};
    write_ply(saved.names().point_cloud(90), other, {});
    write_ply(saved.names().point_cloud(100), one_gaussian(), {});
    SavedRun run = open_saved_run(saved.folder.path(), std::nullopt);
    EXPECT_EQ(run.iteration, 100);
    EXPECT_EQ(run.backend->count(), 1);
    EXPECT_EQ(run.background.z, 1);
    ASSERT_EQ(run.scene.test.size(), 8u);
    EvalOptions options;
    options.run_folder = saved.folder.path();
    options.iteration = run.iteration;
    const RunResult result = evaluate_views(*run.backend, run.scene.test, run.background, options);
    EXPECT_GT(result.psnr, 1);
    const Image picture = read_image(saved.names().render("test", 100, 0));
    EXPECT_GT(picture.value(20, 14, 0), 0.5f) << "the red Gaussian is in the middle";
    EXPECT_LT(picture.value(20, 14, 2), 0.5f);
    EXPECT_GT(picture.value(0, 0, 2), 0.99f) << "the background is that of the run";
    EXPECT_EQ(open_saved_run(saved.folder.path(), 90).iteration, 90);
    EXPECT_THROW(open_saved_run(saved.folder.path(), 95), DataError);
}

TEST(SavedRun, FallsBackToTheCheckpoint) {
    const RunOnDisk saved;
    EXPECT_THROW(open_saved_run(saved.folder.path(), std::nullopt), DataError);
    EXPECT_FALSE(holds_model(saved.folder.path()));
    EXPECT_FALSE(holds_model(""));
    Checkpoint checkpoint;
    checkpoint.state = one_gaussian();
    checkpoint.iteration = 70;
    write_checkpoint(saved.names().checkpoint(70), checkpoint);
    const SavedRun run = open_saved_run(saved.folder.path(), std::nullopt);
    EXPECT_EQ(run.iteration, 70);
    EXPECT_TRUE(holds_model(saved.folder.path()));
    EXPECT_EQ(read_saved_model(saved.folder.path(), 70).state.count, 1);
    EXPECT_EQ(run.backend->count(), 1);
    EXPECT_THROW(open_saved_run(saved.folder.path() / "nowhere", std::nullopt), DataError);
}

TEST(SavedRun, AConfigurationWithoutASceneIsNamed) {
    const RunOnDisk saved;
    write_ply(saved.names().point_cloud(100), one_gaussian(), {});
    saved.folder.write("config.yaml", "iterations: 100\n");
    try {
        open_saved_run(saved.folder.path(), std::nullopt);
        ADD_FAILURE() << "nothing was thrown";
    } catch (const DataError& error) {
        EXPECT_NE(std::string(error.what()).find("config.yaml: no 'source'"), std::string::npos) << error.what();
    }
    EXPECT_EQ(open_saved_run(saved.folder.path(), std::nullopt, {.source = "builtin:diffuse"}).iteration, 100);
}

TEST(SavedRun, FactsNameModelAndStrategy) {
    TrainOptions options;
    options.source = "builtin:glossy";
    const auto backend = make_cpu_backend({"sh", 3, ColorActivation::kRelu});
    RunResult result;
    add_run_facts(result, options, {}, *backend);
    EXPECT_EQ(result.model, "sh (degree 3)");
    EXPECT_EQ(result.strategy, "mcmc");
}

TEST(SavedRun, FactsHaveTheBytesOfAGaussianInFiles) {
    const test::TemporaryFolder folder;
    for (const ModelInfo* model : appearance_models()) {
        TrainOptions options;
        options.source = "builtin:glossy";
        const AppearanceSpec spec{model->name, model->default_max_degree, ColorActivation::kRelu};
        set_appearance(options, spec);
        const auto backend = make_cpu_backend(spec);
        RunResult result;
        add_run_facts(result, options, {}, *backend);
        const std::int64_t unit = ngsplat_unit();
        std::uintmax_t ply[2], web[2];
        for (const int k : {0, 1}) {
            Gaussians g = test::random_gaussians((k + 1) * unit, spec);
            write_ply(folder.path() / "g.ply", g, {});
            ply[k] = std::filesystem::file_size(folder.path() / "g.ply") - std::to_string(g.count).size();
            if (!model->packing) continue;
            write_ngsplat(folder.path() / "g.ngsplat", pack_gaussians(g));
            web[k] = std::filesystem::file_size(folder.path() / "g.ngsplat");
        }
        EXPECT_EQ(ply[1] - ply[0], std::uintmax_t(unit * *result.ply_bytes_per_gaussian)) << model->name;
        if (model->packing) {
            EXPECT_EQ(web[1] - web[0], std::uintmax_t(unit * *result.web_bytes_per_gaussian)) << model->name;
        }
        EXPECT_EQ(result.bytes_per_gaussian, 12 + 4 * model->residual_width(spec.max_degree)) << model->name;
    }
}

// Differences between a run's scene and another one are named, and rounding is none.

/// A scene far from the origin, as from a map, and a run on it.
struct TrainedScene {
    TempFolder folder;
    TrainOptions options;
    Scene scene;

    TrainedScene() {
        std::vector<std::string> names;
        for (int i = 0; i < 9; ++i) names.push_back(fmt::format("im{}.png", i));
        std::vector<test::TestImage> images = test::row_of_images(names);
        for (test::TestImage& image : images) image.pose[4] += 512345.678901;
        test::write_model(folder / "scene/sparse/0", {test::TestCamera{}}, images, {{1, -512345, 0, 0, 1, 2, 3, 2}});
        for (const std::string& name : names) test::write_png(folder / ("scene/images/" + name));
        options.source = (folder / "scene").string();
        options.model = (folder / "run").string();
        options.eval = true;
        scene = load_scene(options);
        write_text_atomic(folder / "run/config.yaml", run_config(options));
        write_cameras_json(folder / "run/cameras.json", scene);
    }
    std::string difference(const TrainOptions& now) const {
        return difference_to_scene(options.model, now, load_scene(now));
    }
    /// Returns what is said of the scene after a change.
    std::string after(const std::function<void(Scene&)>& change) const {
        Scene changed = scene;
        change(changed);
        return difference_to_scene(options.model, options, changed);
    }
};

TEST(RunScene, IsTheSameInAnotherFrameAndOfAnotherSize) {
    const TrainedScene trained;
    EXPECT_EQ(trained.difference(trained.options), "");
    const Scene moved = load_scene(trained.options, {.frame = Frame{{-512000, 3, 4}, 0.25}});
    EXPECT_EQ(difference_to_scene(trained.options.model, trained.options, moved), "");
    TrainOptions other = trained.options;
    other.resolution = 2;
    EXPECT_EQ(trained.difference(other), "") << "the size is an option of the call";
    other = trained.options, other.eval = false;
    EXPECT_EQ(trained.difference(other), "") << "so is the split";
}

TEST(RunScene, IsTheSameAsRoundedTextUnderAnotherName) {
    const TrainedScene trained;
    TempFolder folder;
    std::string images;
    int id = 0;
    for (const auto* views : {&trained.scene.train, &trained.scene.test})
        for (const View& view : *views) {
            const int number = view.name[2] - '0';
            images += fmt::format("{} 1 0 0 0 {:.9g} 0 4 1 {}\n\n", ++id, 0.1 * number + 512345.678901, view.name);
        }
    test::spit(folder / "text/sparse/0/images.txt", images);
    test::spit(folder / "text/sparse/0/cameras.txt", "1 PINHOLE 16 12 20.0001 20 8 6\n");
    test::spit(folder / "text/sparse/0/points3D.txt", "1 -512345 0 0 1 2 3 0.5\n");
    for (const auto* views : {&trained.scene.train, &trained.scene.test})
        for (const View& view : *views) test::write_png(folder / ("text/images/" + view.name));
    TrainOptions other = trained.options;
    other.source = (folder / "text").string();
    EXPECT_EQ(trained.difference(other), "");
}

TEST(RunScene, DifferencesAreNamedWithTheFirstImageThatHasThem) {
    const TrainedScene trained;
    EXPECT_EQ(trained.after([](Scene& s) { s.train.pop_back(); }),
              "it has 8 images, and the run has 9; 'im7.png' is missing");
    EXPECT_EQ(trained.after([](Scene& s) { s.train.push_back(s.train[0]), s.train.back().name = "new.png"; }),
              "it has 10 images, and the run has 9; 'new.png' is not of the run");
    EXPECT_EQ(trained.after([](Scene& s) { s.train[0].name = "new.png"; }),
              "it has other images; 'im1.png' is missing; 'new.png' is not of the run");
    EXPECT_EQ(trained.after([](Scene& s) { s.test.push_back(s.train.back()), s.train.pop_back(); }),
              "'im7.png' is a test view, and a training view of the run");
    EXPECT_EQ(trained.after([](Scene& s) { s.train[1].camera.width = 8; }),
              "'im2.png' has 8x12 pixels, and 16x12 in the run");
    EXPECT_EQ(trained.after([](Scene& s) { s.train[1].camera.fx *= 1.01; }),
              "the camera of 'im2.png' has focal lengths of 20.2 and 20 pixels, and 20 and 20 in the run");
    EXPECT_EQ(trained.after([](Scene& s) { s.train[1].camera.cy += 0.5; }),
              "the camera of 'im2.png' has its principal point at (8, 6.5), and at (8, 6) in the run");
    EXPECT_EQ(trained.after([](Scene& s) {
        s.train[1].camera.rotation = Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY()) * s.train[1].camera.rotation;
    }),
              "the camera of 'im2.png' looks in another direction than in the run");
}

TEST(RunScene, ACameraThatMovedIsAnother) {
    TrainedScene trained;
    for (auto* views : {&trained.scene.train, &trained.scene.test})  // to where a step is larger than rounding
        for (View& view : *views) view.camera.translation.x() *= 0.01;
    trained.scene.frame = {};
    write_cameras_json(trained.folder / "run/cameras.json", trained.scene);
    const std::string text = trained.after([](Scene& s) { s.train[1].camera.translation.z() += 0.25; });
    EXPECT_EQ(text, "the camera of 'im2.png' stands 0.25 units from where it stands in the run");
}

TEST(RunScene, CamerasOfARunComeBackExactly) {
    const TrainedScene trained;
    const std::vector<ListedView> views = read_cameras_json(trained.folder / "run/cameras.json");
    ASSERT_EQ(views.size(), 9u);
    EXPECT_EQ(views[0].name, "im0.png");
    EXPECT_TRUE(views[0].is_test && views[1].is_test && !views[2].is_test);
    EXPECT_EQ(views[1].camera.cx, trained.scene.test[1].camera.cx);
    test::spit(trained.folder / "run/cameras.json", R"([{"split": "test", "img_name": 3}])");
    EXPECT_THROW(read_cameras_json(trained.folder / "run/cameras.json"), DataError);
    test::spit(trained.folder / "run/cameras.json", R"([{"id": 0, "img_name": "a", "width": 3}])");
    EXPECT_TRUE(read_cameras_json(trained.folder / "run/cameras.json").empty()) << "of an older version";
}

}  // namespace
}  // namespace gs
