// SPDX-License-Identifier: Apache-2.0
// Options that runs of one experiment may differ in change no bit of what is trained; all others tell runs apart.
#include "eval/runs/run_scene.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>

#include "apps/gsapp/train/train_run.h"
#include "eval/report/table.h"
#include "lib/core/options.h"
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
    validate(options);
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
        {"image-cache", [](TrainOptions& o) { o.image_cache = "1KiB"; }},
        {"verify-images", [](TrainOptions& o) { o.verify_images = VerifyImages::kOff; }},
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
        validate(options);
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
        for (const char* value : {"0", "1", "2", "true", "false", "white"}) values.push_back(value);
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

}  // namespace
}  // namespace gs
