// SPDX-License-Identifier: Apache-2.0
// Opening a run folder again, from its PLY and from its checkpoint.
#include "eval/runs/saved_run.h"

#include <gtest/gtest.h>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/export/ngsplat.h"
#include "lib/export/pack_scene.h"
#include "lib/model/checkpoint.h"
#include "lib/model/ply.h"
#include "lib/model/run_folder.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/tiny_run.h"
#include "tests/kernels/backends.h"
#include "tests/model/model_helpers.h"

namespace gs {
namespace {

using test::one_gaussian;

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
        validate(options);
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
    const EvalResult result = evaluate_views(*run.backend, run.scene.test, run.background, options);
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
    Scene scene;
    scene.split_rule = "every 8th";
    const auto backend = make_cpu_backend({"sh", 3, ColorActivation::kRelu});
    const RunFacts facts = run_facts(options, scene, {0, 0, 0}, *backend);
    EXPECT_EQ(facts.model, "sh (degree 3)");
    EXPECT_EQ(facts.strategy, "mcmc");
    EXPECT_EQ(facts.split_rule, "every 8th");
}

TEST(SavedRun, FactsHaveTheBytesOfAGaussianInFiles) {
    const test::TemporaryFolder folder;
    for (const ModelInfo* model : appearance_models()) {
        TrainOptions options;
        options.source = "builtin:glossy";
        const AppearanceSpec spec{model->name, model->default_max_degree, ColorActivation::kRelu};
        set_appearance(options, spec);
        const auto backend = make_cpu_backend(spec);
        const RunFacts facts = run_facts(options, {}, {0, 0, 0}, *backend);
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
        EXPECT_EQ(ply[1] - ply[0], std::uintmax_t(unit * facts.ply_bytes_per_gaussian)) << model->name;
        if (model->packing) {
            EXPECT_EQ(web[1] - web[0], std::uintmax_t(unit * *facts.web_bytes_per_gaussian)) << model->name;
        }
        EXPECT_EQ(facts.bytes_per_gaussian, 12 + 4 * model->residual_width(spec.max_degree)) << model->name;
    }
}

}  // namespace
}  // namespace gs
