// SPDX-License-Identifier: Apache-2.0
// Photographs through wide lenses, from training to pages, as a user of the program has them.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "lib/io/image.h"
#include "tests/apps/program.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using test::Outcome;
using test::Program;

constexpr const char* kSmall = " --eval -r 48 --iterations 30 --init-points 600 --cap-max 800 ";

double brightest(const Image& image) {
    double most = 0;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) most = std::max(most, double(image.value(x, y, 1)));
    return most;
}

void expect_ok(const Program& program, const std::string& arguments) {
    const Outcome outcome = program.run(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.err;
}

TEST(LensCommands, A200DegreeLensTrainsScoresRendersAndExports) {
    Program program;
    program.train("run", "-s builtin:room-200 --appearance sh" + std::string(kSmall));
    const auto results = parse_json(program.read("run/results.json"));
    EXPECT_GT(results.at("ours_30").at("PSNR").get<double>(), 12);
    expect_ok(program, "eval run --device cpu");
    expect_ok(program, "eval run -s builtin:room -r 48 --eval --device cpu");
    EXPECT_TRUE(fs::exists(program.path("run/on-room/results.json")));

    expect_ok(program, "render run --lens equirectangular --size 64x32 --depth --device cpu -o all");
    const Image around = read_image(program.path("all/00000.png"));
    EXPECT_EQ(around.width, 64);
    EXPECT_EQ(around.height, 32);
    EXPECT_GT(brightest(around), 0.1);
    expect_ok(program, "render run --lens fisheye --lens-fov 220 --size 40x40 --orbit 3 --device cpu -o dome");
    EXPECT_EQ(read_image(program.path("dome/00002.png")).width, 40);
    expect_ok(program, "render run --lens pinhole --device cpu -o flat");
    EXPECT_EQ(program.run("render run --lens square --device cpu").exit_code, 2);

    expect_ok(program, "export run --format ply -o model.ply --device cpu");
    const Outcome undistorted = program.run("eval run --lens undistort --device cpu");
    EXPECT_EQ(undistorted.exit_code, 3) << "no pinhole image sees 200 degrees";
    EXPECT_NE(undistorted.err.find("180 degrees"), std::string::npos) << undistorted.err;
}

TEST(LensCommands, A360DegreeTrainingResumesToTheSameModel) {
    Program program;
    const std::string options = "-s builtin:room-360 --appearance none --device cpu --quiet" + std::string(kSmall);
    program.train("whole", options);
    expect_ok(program, "train -m parts --checkpoint-iterations 10 " + options);
    fs::remove_all(program.path("parts/point_cloud"));
    expect_ok(program, "train -m parts --resume parts/checkpoints/iteration_10.safetensors --overwrite " + options);
    const std::string resumed = program.read("parts/point_cloud/iteration_30/point_cloud.ply");
    EXPECT_GT(resumed.size(), 1000u);
    EXPECT_TRUE(resumed == program.read("whole/point_cloud/iteration_30/point_cloud.ply"));
}

TEST(LensCommands, AModelIsScoredThroughTheLensAndWithoutIt) {
    Program program;
    program.train("run", "-s builtin:room-k1 --lens native --appearance none" + std::string(kSmall));
    expect_ok(program, "eval run --lens undistort --device cpu");
    EXPECT_TRUE(fs::exists(program.path("run/on-undistort/results.json")));
    expect_ok(program, "train -s builtin:room-k1 --device cpu --quiet -m flat" + std::string(kSmall));
}

TEST(LensCommands, OptionsThatSendOrScoreSplatsTakeLenses) {
    Program program;
    const std::string train = "train -s builtin:room-200 --device cpu --quiet --overwrite -m run ";
    for (const char* options : {"--batch 2 --appearance none", "--appearance none --ppisp on --controller-iterations 4",
                                "--appearance sh --appearance-share 0.5",
                                "--appearance none --strategy adc --speedy-splat --densify-until-iter 20"}) {
        expect_ok(program, train + options + kSmall);
        const auto results = parse_json(program.read("run/results.json"));
        EXPECT_GT(results.at("ours_30").at("PSNR").get<double>(), 7) << options;  // 30 iterations
    }
}

}  // namespace
}  // namespace gs
