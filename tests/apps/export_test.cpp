// SPDX-License-Identifier: Apache-2.0
// gsapp export and view on a run of the program.
#include <gtest/gtest.h>

#include "lib/export/ngsplat.h"
#include "lib/export/site.h"
#include "lib/model/ply.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using test::Outcome;
using test::Program;

/// A run of `sv`, which depends on the view from the first iteration on.
void train(const Program& program, const std::string& more = "") {
    const Outcome outcome = program.run(
        "train -s builtin:glossy --eval --device cpu --quiet --appearance sv --iterations 30 --init-points 500 -r 8 -m "
        "run " +
        more);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
}

TEST(Export, WritesPackedSceneWithWhatItLost) {
    const Program program;
    train(program, "--ppisp on --controller-iterations 5");
    const Outcome outcome = program.run("export run -o 'my site'");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_NE(outcome.err.find("128 bytes each"), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("dB lost"), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find("device: "), outcome.err.rfind("device: ")) << "said once: " << outcome.err;
    EXPECT_EQ(fs::exists(program.path("my site/index.html")), !viewer_folder().empty());
    const PackedScene scene = read_ngsplat(program.path("my site/scene.ngsplat"));
    EXPECT_GT(scene.count(), 0);
    EXPECT_GT(scene.cameras.size(), 0u);
    ASSERT_TRUE(scene.ppisp);
    EXPECT_EQ(scene.ppisp->views.size(), scene.cameras.size());
    for (const char* key :
         {"\"appearance\":\"sv\"", "\"background\":[", "\"packed_psnr\":", "\"photometric\":\"controller\""})
        EXPECT_NE(scene.trailer.find(key), std::string::npos) << key << " in " << scene.trailer;

    const Outcome again = program.run("export run -o 'my site'");
    EXPECT_EQ(again.exit_code, 2);
    EXPECT_NE(again.err.find("--overwrite"), std::string::npos);
    EXPECT_EQ(program.run("export run -o 'my site' --overwrite").exit_code, 0);
    for (const auto& entry : fs::directory_iterator(program.folder().path()))
        EXPECT_NE(entry.path().extension(), ".tmp") << entry.path();
}

TEST(Export, WritesFilesForOtherPrograms) {
    const Program program;
    train(program);
    ASSERT_EQ(program.run("export run -o out --format ply").exit_code, 0);
    const Gaussians own = read_ply(program.path("out/point_cloud.ply"));
    EXPECT_EQ(own.appearance.model, "sv");
    ASSERT_EQ(program.run("export run -o out --format splat").exit_code, 0);
    EXPECT_EQ(fs::file_size(program.path("out/point_cloud.splat")), 32u * std::size_t(own.count));
    const Outcome projected = program.run("export run -o sh --format ply --sh-projection");
    ASSERT_EQ(projected.exit_code, 0) << projected.err;
    EXPECT_NE(projected.err.find("dB over all directions"), std::string::npos) << projected.err;
    const Gaussians sh = read_ply(program.path("sh/point_cloud.ply"));
    EXPECT_EQ(sh.appearance.model, "sh");
    EXPECT_EQ(sh.count, own.count);
    EXPECT_NE(program.read("sh/point_cloud.ply").find("comment spherical harmonics fitted to the colours of sv, "),
              std::string::npos);
}

TEST(Export, WhatCannotBeExportedLeavesNothing) {
    const Program program;
    const auto refused = [&](const std::string& arguments, int exit_code, const std::string& word) {
        const Outcome outcome = program.run(arguments);
        EXPECT_EQ(outcome.exit_code, exit_code) << arguments << "\n" << outcome.err;
        EXPECT_NE(outcome.err.find(word), std::string::npos) << arguments << "\n" << outcome.err;
        EXPECT_FALSE(fs::exists(program.path("out"))) << arguments;
    };
    refused("export nowhere -o out", 3, "nowhere");
    refused("export nowhere -o out --format ply", 3, "nowhere");
    refused("export nowhere -o out --format sog", 2, "sog");
    refused("export nowhere -o out --sh-projection", 2, "--format ply");
    refused("view out", 2, "out");
}

}  // namespace
}  // namespace gs
