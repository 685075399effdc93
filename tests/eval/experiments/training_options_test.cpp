// SPDX-License-Identifier: Apache-2.0
// Options that runs of one experiment may differ in change no bit of what is trained; all others tell runs apart.
#include "eval/runs/run_scene.h"

#include <gtest/gtest.h>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>

#include "apps/gsapp/train/train_run.h"
#include "eval/runs/results.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/model/checkpoint.h"
#include "lib/model/run_folder.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kIterations = 60, kCheckpoint = 30;

/// A training in which Gaussians are relocated, added and corrected photometrically.
TrainOptions tiny(const fs::path& folder) {
    TrainOptions options;
    options.source = "builtin:diffuse";
    options.model = folder.string();
    options.resolution = 8;
    options.eval = true;
    options.device = Device::kCpu;
    options.iterations = kIterations;
    options.cap_max = 5100;  // 5000 points
    options.ppisp = PpispMode::kOn;
    options.controller_iterations = 0;
    options.quiet = true;
    options.checkpoint_iterations = {kCheckpoint};
    return options;
}

std::string bytes(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

/// Trains, and returns the model and its correction.
std::string trained(TrainOptions options) {
    options = resolve(options);
    train_run(options, 0);
    const RunFolder folder{options.model};
    const std::string cloud = bytes(folder.point_cloud(kIterations));
    EXPECT_FALSE(cloud.empty());
    return cloud + bytes(folder.ppisp());
}

TEST(TrainingOptions, OfNoAccountChangeNoBitOfTheModel) {
    const test::TemporaryFolder tmp;
    const std::string model = trained(tiny(tmp.path() / "first"));
    const std::map<std::string, std::function<void(TrainOptions&)>> changes = {
        {"model", [](TrainOptions&) {}},  // every run below has another
        {"image-cache", [](TrainOptions& o) { o.image_cache = parse_bytes("1KiB", ""); }},
        {"verify-images", [](TrainOptions& o) { o.verify_images = VerifyImages::kOff; }},
        {"threads", [](TrainOptions& o) { o.threads = 1; }},
        {"overwrite",
         [&](TrainOptions& o) {
             o.overwrite = true;
             fs::copy(tmp.path() / "first", o.model, fs::copy_options::recursive);
         }},
        {"resume",
         [&](TrainOptions& o) { o.resume = RunFolder{tmp.path() / "first"}.checkpoint(kCheckpoint).string(); }},
        {"test-iterations",
         [](TrainOptions& o) {
             o.test_iterations = {7, 50};
         }},
        {"save-iterations",
         [](TrainOptions& o) {
             o.save_iterations = {7, 50};
         }},
        {"checkpoint-iterations",
         [](TrainOptions& o) {
             o.checkpoint_iterations = {7, 50};
         }},
        {"checkpoint-minutes", [](TrainOptions& o) { o.checkpoint_minutes = 1e-9; }},
        {"preview-every", [](TrainOptions& o) { o.preview_every = 7; }},
        {"quiet", [](TrainOptions& o) { o.quiet = false; }},
        {"verbose", [](TrainOptions& o) { o.verbose = true; }},
        {"tensorboard", [&](TrainOptions& o) { o.tensorboard = (tmp.path() / "events").string(); }},
        {"seed", {}},  // is chance, and compared beside these options
    };
    const auto significant = training_options(TrainOptions{});
    for (const Option& option : train_option_table()) {
        if (significant.contains(option.key)) continue;
        SCOPED_TRACE(option.key);
        const auto change = changes.find(option.key);
        ASSERT_NE(change, changes.end()) << "no run shows that it changes nothing";
        if (!change->second) continue;
        TrainOptions options = tiny(tmp.path() / option.key);
        change->second(options);
        EXPECT_TRUE(trained(options) == model);
        options.overwrite = false;
        options = resolve(options);
        EXPECT_TRUE(holds_same_run(options));
    }
}

TEST(TrainingOptions, OfAllOthersTwoValuesAreTwoExperiments) {
    const TrainOptions base;
    const auto texts = training_options(base);
    EXPECT_TRUE(texts.contains("auto-tolerance")) << "it decides which residuals go";
    for (const Option& option : train_option_table()) {
        if (!texts.contains(option.key)) continue;
        std::vector<std::string> values = option.choices;
        for (const char* value : {"0", "1", "2", "true", "false", "white", "1s", "1MB"}) values.push_back(value);
        bool differs = false;
        for (const std::string& value : values) {
            TrainOptions changed = base;
            try {
                set_option(changed, option, {value}, option.key);
            } catch (const std::exception&) {
                continue;  // not a value of this option
            }
            differs = differs || training_options(changed) != texts;
        }
        EXPECT_TRUE(differs) << option.key;
    }
}

TEST(TrainingOptions, RelativeAndAbsolutePathsAreTheSame) {
    TrainOptions named, absolute;
    named.source = "scene", named.test_list = "list.txt";
    absolute.source = fs::absolute("scene").string(), absolute.test_list = fs::absolute("list.txt").string();
    EXPECT_EQ(training_options(named), training_options(absolute));
}

// Two iterations of a small scene, with and without evaluation.

TrainOptions tiny(const test::TemporaryFolder& tmp) {
    TrainOptions options;
    options.source = "builtin:diffuse";
    options.resolution = 8;
    options.device = Device::kCpu;
    options.appearance = "none";
    options.iterations = 2;
    options.quiet = true;
    options.model = (tmp.path() / "run").string();
    return options;
}

TEST(TrainRun, ScoresWhatWasHeldOut) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options.eval = true;
    options = resolve(options);
    const std::optional<RunResult> row = train_run(options, 1);
    ASSERT_TRUE(row);
    EXPECT_EQ(row->iteration, 2);
    EXPECT_GT(row->psnr, 0);
    EXPECT_TRUE(row->train_seconds);
    EXPECT_TRUE(row->frame_seconds);
    EXPECT_FALSE(row->training.empty()) << "the options are those of the run";
    for (const char* file :
         {"config.yaml", "results.json", "comparison.png", "gsapp.log", "point_cloud/iteration_2/point_cloud.ply"})
        EXPECT_TRUE(std::filesystem::exists(std::filesystem::path(options.model) / file)) << file;
}

TEST(TrainRun, HasNoRowWithoutEvaluation) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options = resolve(options);
    EXPECT_FALSE(train_run(options, 0));
    EXPECT_FALSE(std::filesystem::exists(std::filesystem::path(options.model) / "results.json"));
}

TEST(TrainRun, TargetsAreMeasuredOnViewsThatAreNotTrainedOn) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options.eval = true, options.target_psnr = 5;
    options.iterations = 40, options.init_points = 200, options.cap_max = 300;
    options = resolve(options);
    ASSERT_TRUE(train_run(options, 0));
    std::ifstream file(std::filesystem::path(options.model) / "results.json");
    const auto results = nlohmann::json::parse(file);
    const auto& plan = results.at("plan").begin().value();
    const auto& target = plan.at("target");
    EXPECT_EQ(target.at("psnr"), 5);
    EXPECT_GT(target.at("held_out_views"), 0);
    EXPECT_TRUE(target.at("reached")) << target.dump();
    EXPECT_GE(target.at("held_out_psnr"), 5);
    EXPECT_GE(target.at("standard_error"), 0);
    EXPECT_EQ(plan.at("recipe"), "frontier");
}

TEST(TrainRun, ARunIsResumedWithATargetOnlyIfItBeganWithOne) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options = resolve(options);
    train_run(options, 0);
    const auto config = [&] {
        std::ifstream file(RunFolder{options.model}.config());
        return std::string(std::istreambuf_iterator<char>(file), {});
    };
    const std::string before = config();
    options.resume = "latest", options.iterations = 4, options.target_psnr = 5;
    options = resolve(options);
    EXPECT_THROW(train_run(options, 0), UsageError);
    EXPECT_EQ(config(), before) << "the run can go on without it";
}

TEST(TrainRun, ACheckpointWhoseOptionsAreBrokenIsRefused) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options = resolve(options);
    train_run(options, 0);
    const auto file = RunFolder{options.model}.checkpoint(2);
    const Checkpoint whole = read_checkpoint(file);
    options.resume = file.string(), options.iterations = 4;
    for (const char* text : {"target-psnr: [", "target-psnr: high"}) {
        Checkpoint broken = whole;
        broken.options_yaml = text;
        write_checkpoint(file, broken);
        EXPECT_THROW(train_run(options, 0), DataError) << text;
    }
}

TEST(TrainRun, ATargetNeedsEnoughViews) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options.target_psnr = 5;
    options = resolve(options);
    Scene scene;
    EXPECT_THROW(TargetViews(options, scene), UsageError) << "no view";
}

}  // namespace
}  // namespace gs
