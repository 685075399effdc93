// SPDX-License-Identifier: Apache-2.0
// Files of limited size: what is planned against what is written.
#include "apps/gsapp/train/plan.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/export/ngsplat.h"
#include "lib/export/pack_scene.h"
#include "lib/export/splat_file.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/initialize.h"
#include "lib/model/ply.h"
#include "lib/scene/procedural.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TrainOptions options_of(const std::string& appearance, const std::string& limit, SizeOf of) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.appearance = appearance, o.named = {"appearance"};
    o.size_limit = limit, o.size_of = of;
    o.init_points = 5000;
    validate(o);
    return o;
}

const Scene& scene() {
    static const Scene scene = [] {
        SceneOptions options;
        options.resolution = 16;
        return load_builtin_scene("diffuse", options);
    }();
    return scene;
}

Gaussians model_of(const TrainOptions& o, std::int64_t count) {
    InitOptions init = init_options(o);
    init.most_points = count;
    Gaussians model = initialize_gaussians(scene(), appearance_spec(o), init);
    model.active_degree = model.appearance.max_degree;
    return model;
}

class SizePlanOf : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, SizePlanOf, ::testing::ValuesIn(appearance_names()),
                         [](const auto& info) { return info.param; });

TEST_P(SizePlanOf, IsTheSizeOfTheFile) {
    const test::TemporaryFolder tmp;
    for (const std::int64_t count : {1, 2048, 2049}) {
        const TrainOptions web = options_of(GetParam(), "100MB", SizeOf::kWeb);
        const Gaussians model = model_of(web, count);
        ASSERT_EQ(model.count, count);
        PackedScene packed = pack_gaussians(model);
        packed.cameras.resize(scene().test.size());
        packed.trailer = std::string(1024, ' ');
        const auto scene_file = tmp.path() / "scene.ngsplat", ply_file = tmp.path() / "model.ply";
        write_ngsplat(scene_file, packed);
        EXPECT_EQ(plan_size(web, scene()).bytes(count), std::int64_t(std::filesystem::file_size(scene_file)));

        const TrainOptions ply = options_of(GetParam(), "100MB", SizeOf::kPly);
        write_ply(ply_file, model, {});
        const auto real = std::int64_t(std::filesystem::file_size(ply_file));
        EXPECT_GE(plan_size(ply, scene()).bytes(count), real);
        EXPECT_LE(plan_size(ply, scene()).bytes(count), real + 4096);
    }
}

TEST_P(SizePlanOf, TheMostFitsAndOneUnitMoreDoesNot) {
    for (const SizeOf of : {SizeOf::kWeb, SizeOf::kPly}) {
        const SizePlan plan = plan_size(options_of(GetParam(), "3MB", of), scene());
        EXPECT_LE(plan.bytes(plan.most_gaussians), 3000000);
        EXPECT_GT(plan.bytes(plan.most_gaussians + 1), 3000000);
    }
}

TEST(SizePlan, ASplatFileHasOneColourAndNoHeader) {
    TrainOptions o;
    o.source = "builtin:diffuse", o.size_limit = "1MB", o.size_of = SizeOf::kSplat;
    validate(o);
    EXPECT_EQ(o.appearance, "none");
    EXPECT_EQ(o.recipe, Recipe::kFrontier);
    EXPECT_EQ(plan_size(o, scene()).most_gaussians, 31250);
}

TEST(SizePlan, ASizeBelowTheSmallestFileIsRefusedWithThatSize) {
    try {
        plan_size(options_of("sh", "1KB", SizeOf::kWeb), scene());
        FAIL();
    } catch (const UsageError& e) {
        EXPECT_NE(std::string(e.what()).find("1KB is too small: the smallest web file of sh takes 11"),
                  std::string::npos)
            << e.what();
    }
    for (const char* text : {"0", "-5MB", "many", "5XB"}) {
        TrainOptions o;
        o.source = "builtin:diffuse", o.size_limit = text;
        EXPECT_THROW(
            {
                validate(o);
                plan_size(o, scene());
            },
            UsageError)
            << text;
    }
}

}  // namespace
}  // namespace gs
