// SPDX-License-Identifier: Apache-2.0
// A run with learned cameras from training to evaluation, and a second run on its cameras.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "tests/apps/program.h"
#include "tests/scene/scene_fixture.h"

namespace gs::test {
namespace {

TEST(RefineCommand, PhotometricCorrectionGoesOnAsItWasDecided) {
    Program program;
    const std::string options =
        "train -s builtin:exposure -m run --resolution 16 --ppisp auto --controller-iterations 0 --device cpu "
        "--init-points 100 --cap-max 200 --iterations ";
    const Outcome trained = program.run(options + "7000");
    EXPECT_EQ(trained.exit_code, 0) << trained.err;
    EXPECT_NE(trained.err.find("--ppisp auto: on: "), std::string::npos) << trained.err;
    EXPECT_NE(program.read("run/stats/train.jsonl").find("\"event\":\"photometric\""), std::string::npos);
    EXPECT_NE(program.read("run/config.yaml").find("ppisp: on"), std::string::npos);
    const Outcome resumed = program.run(options + "7020 --resume latest");
    EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
    EXPECT_EQ(resumed.err.find("--ppisp auto"), std::string::npos) << resumed.err;
    EXPECT_NE(program.read("run/config.yaml").find("ppisp: on"), std::string::npos);
}

TEST(RefineCommand, TrainsScoresAndTrainsOnItsCameras) {
    Program program;
    write_colmap_scene(program.path("scene"), numbered(10));
    const std::string options = " --device cpu --eval --cap-max 50 --iterations 60";
    const auto expect_ok = [&](const std::string& arguments) {
        const Outcome outcome = program.run(arguments);
        EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.err;
        return outcome;
    };
    const Outcome trained = expect_ok("train -s scene -m run --refine-cameras on" + options);
    EXPECT_NE(trained.err.find("cameras: moved by"), std::string::npos) << trained.err;
    const auto listed = parse_json(program.read("run/cameras.json"));
    std::size_t refined = 0, corrected = 0;
    for (const auto& entry : listed) refined += entry.contains("given"), corrected += entry.contains("correction");
    EXPECT_EQ(refined, 10u) << "test images have the learned lens";
    EXPECT_EQ(corrected, 8u) << "training images";
    EXPECT_TRUE(std::filesystem::exists(program.path("run/refined/corrections/7.jpg")));
    for (const auto& entry : listed)
        if (entry["split"] == "test") {
            EXPECT_EQ(entry["position"], entry["given"]["position"]);
        }

    const Outcome scored = expect_ok("eval run --align-test cameras --device cpu --html page.html");
    EXPECT_NE(program.read("page.html").find("<h2 id=\"h-cameras\">"), std::string::npos);
    EXPECT_NE(scored.err.find("aligned to the model"), std::string::npos) << scored.err;
    const auto results = parse_json(program.read("run/results.json"));
    EXPECT_TRUE(results["aligned_cameras"]["ours_60"]["aligned_psnr"].is_number());
    EXPECT_TRUE(results["protocol"]["ours_60"].contains("aligned_cameras"));
    EXPECT_EQ(scored.out.find("aligned"), std::string::npos) << "tables have the given cameras";

    expect_ok("render run --views train -o pictures");
    // Another run in the same folder has no such cameras.
    expect_ok("train -s scene -m other --refine-cameras on" + options);
    EXPECT_TRUE(std::filesystem::exists(program.path("other/refined/transforms.json")));
    expect_ok("train -s scene -m other --overwrite" + options);
    EXPECT_FALSE(std::filesystem::exists(program.path("other/refined")));
    EXPECT_TRUE(std::filesystem::exists(program.path("scene/images")));

    // Ten images are too few to hold some out, which auto says; a resumed run goes on as it began.
    const Outcome chosen =
        expect_ok("train -s scene -m chosen --refine-cameras auto --ppisp auto --ppisp-exif" + options);
    EXPECT_NE(chosen.err.find("--refine-cameras auto: off: "), std::string::npos) << chosen.err;
    EXPECT_NE(chosen.err.find("--ppisp auto: off: "), std::string::npos) << chosen.err;
    EXPECT_NE(program.read("chosen/config.yaml").find("ppisp: off"), std::string::npos);
    EXPECT_NE(program.read("chosen/config.yaml").find("refine-cameras: off"), std::string::npos);
    const auto decided = parse_json(program.read("chosen/results.json"));
    EXPECT_EQ(decided["refine_cameras"]["ours_60"].get<std::string>().substr(0, 4), "off:");
    EXPECT_EQ(decided["photometric"]["ours_60"]["decision"].get<std::string>().substr(0, 4), "off:");
    expect_ok("train -m chosen --resume latest --iterations 80");
    expect_ok("train -s scene -m longer --refine-cameras auto --resume run/checkpoints/iteration_60.safetensors" +
              options + " --iterations 80");
    EXPECT_NE(program.read("longer/config.yaml").find("refine-cameras: on"), std::string::npos);

    const auto expect_same_places = [&](const std::string& a, const std::string& b) {
        const auto before = parse_json(program.read(a + "/cameras.json")),
                   now = parse_json(program.read(b + "/cameras.json"));
        ASSERT_EQ(now.size(), before.size());
        for (std::size_t k = 0; k < now.size(); ++k)
            for (int axis = 0; axis < 3; ++axis)
                EXPECT_NEAR(now[k]["position"][axis].get<double>(), before[k]["position"][axis].get<double>(), 1e-6);
    };
    expect_ok("train -s run/refined -m again" + options);
    expect_same_places("run", "again");
    expect_ok("train -s run/refined -m more --refine-cameras on" + options);  // its photographs are in a linked folder
    expect_ok("train -s more/refined -m last" + options);
    expect_same_places("more", "last");
}

}  // namespace
}  // namespace gs::test
