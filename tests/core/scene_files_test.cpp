// SPDX-License-Identifier: Apache-2.0
// The files of scenes/: every benchmark scene is there, is read by the real parser, and says what the protocol says.
#include <gtest/gtest.h>

#include <set>

#include "lib/core/options.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

const fs::path kScenes = fs::path(GSAPP_SOURCE_DIR) / "scenes";

/// The options in which scenes differ. They are written here a second time, so that a slip in a file does not pass
/// unseen.
struct Expected {
    const char* scene;
    std::int64_t cap_max;
    const char* images;
    double opacity_reg;
};

constexpr Expected kExpected[] = {
    {"mipnerf360/bicycle", 6000000, "images_4", 0.01},    {"mipnerf360/flowers", 3000000, "images_4", 0.01},
    {"mipnerf360/garden", 5000000, "images_4", 0.01},     {"mipnerf360/stump", 4500000, "images_4", 0.01},
    {"mipnerf360/treehill", 3500000, "images_4", 0.01},   {"mipnerf360/bonsai", 1500000, "images_2", 0.01},
    {"mipnerf360/counter", 1500000, "images_2", 0.01},    {"mipnerf360/kitchen", 1500000, "images_2", 0.01},
    {"mipnerf360/room", 1500000, "images_2", 0.01},       {"tanksandtemples/train", 1000000, "images", 0.01},
    {"tanksandtemples/truck", 2500000, "images", 0.01},   {"deepblending/drjohnson", 3500000, "images", 0.001},
    {"deepblending/playroom", 2500000, "images", 0.001},  {"nerf-synthetic/chair", 300000, "images", 0.01},
    {"nerf-synthetic/drums", 300000, "images", 0.01},     {"nerf-synthetic/ficus", 300000, "images", 0.01},
    {"nerf-synthetic/hotdog", 300000, "images", 0.01},    {"nerf-synthetic/lego", 300000, "images", 0.01},
    {"nerf-synthetic/materials", 300000, "images", 0.01}, {"nerf-synthetic/mic", 300000, "images", 0.01},
    {"nerf-synthetic/ship", 300000, "images", 0.01},
};

TEST(SceneFiles, SayWhatTheProtocolSays) {
    for (const Expected& expected : kExpected) {
        SCOPED_TRACE(expected.scene);
        TrainOptions options = load_options_yaml(kScenes / (std::string(expected.scene) + ".yaml"));
        EXPECT_TRUE(options.source.empty() && options.model.empty())
            << "where data and results lie is the user's choice";
        options.source = "builtin:diffuse";
        ASSERT_NO_THROW(resolve(options));
        EXPECT_EQ(options.cap_max, expected.cap_max);
        EXPECT_EQ(options.images, expected.images);
        EXPECT_EQ(options.opacity_reg, expected.opacity_reg);
        EXPECT_EQ(options.scale_reg, 0.01);
        EXPECT_EQ(options.iterations, 30000);
        EXPECT_EQ(options.strategy, Strategy::kMcmc);
        EXPECT_EQ(options.resolution, 1);
        EXPECT_EQ(background_text(options.background), "black");
        EXPECT_EQ(options.init_points, 100000);
        const bool rendered = std::string(expected.scene).starts_with("nerf-synthetic/");
        EXPECT_EQ(options.ppisp, rendered ? PpispMode::kOff : PpispMode::kOn);
        EXPECT_TRUE(options.eval);
        EXPECT_EQ(options.test_every, 8);
    }
}

TEST(SceneFiles, AreTheBenchmarkScenesAndTheirBasesOnly) {
    std::set<std::string> expected = {"base.yaml"}, found;
    for (const Expected& e : kExpected) {
        expected.insert(std::string(e.scene) + ".yaml");
        expected.insert(fs::path(e.scene).parent_path() / "base.yaml");
    }
    EXPECT_EQ(std::size(kExpected), 21u);
    for (const auto& entry : fs::recursive_directory_iterator(kScenes)) {
        const fs::path name = entry.path().lexically_relative(kScenes);
        // The built-in scenes are geometry, not options.
        if (entry.is_regular_file() && *name.begin() != "procedural") found.insert(name);
    }
    EXPECT_EQ(found, expected);
}

}  // namespace
}  // namespace gs
