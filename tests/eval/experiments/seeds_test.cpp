// SPDX-License-Identifier: Apache-2.0
// Runs with several seeds: which are trained, and in which folders; and the folder of a run that names none.
#include "apps/gsapp/train/seeds.h"

#include <gtest/gtest.h>

#include "apps/gsapp/train/train_run.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TrainOptions base_options() {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.model = "out/run";
    o.seed = 5;
    o.eval = true;
    return o;
}

TEST(Seeds, EachRunHasItsSeedAndItsFolder) {
    std::vector<std::pair<std::uint64_t, std::string>> trained;
    const auto rows = train_seeds(base_options(), 3, [&](const TrainOptions& options) -> std::optional<TableRow> {
        trained.push_back({options.seed, options.model});
        if (options.seed == 6) return std::nullopt;  // nothing was scored
        TableRow row;
        row.psnr = double(options.seed);
        return row;
    });
    EXPECT_EQ(trained, (std::vector<std::pair<std::uint64_t, std::string>>{
                           {5, "out/run-0"}, {6, "out/run-1"}, {7, "out/run-2"}}));
    ASSERT_EQ(rows.size(), 2u);
    EXPECT_EQ(rows[1].psnr, 7);
}

TEST(Seeds, MistakesComeBeforeAnyTraining) {
    const auto untouched = [](const TrainOptions&) -> std::optional<TableRow> {
        throw std::logic_error("nothing was to be trained");
    };
    TrainOptions resumed = base_options(), chosen = base_options(), unscored = base_options();
    resumed.resume = "latest", chosen.appearance = kAutoAppearance, unscored.eval = false;
    for (const TrainOptions& options : {resumed, chosen, unscored})
        EXPECT_THROW(train_seeds(options, 2, untouched), UsageError);
}

TEST(FreeRunFolder, IsTheFirstNumberThatIsNotTaken) {
    const test::TemporaryFolder tmp;
    const auto name = [&](const std::string& last) { return (tmp.path() / last).string(); };
    EXPECT_EQ(free_run_folder(tmp.path(), base_options()), name("diffuse-sh-1"));
    std::filesystem::create_directory(name("diffuse-sh-1"));
    std::filesystem::create_directory(name("diffuse-sh-2-0"));
    EXPECT_EQ(free_run_folder(tmp.path(), base_options()), name("diffuse-sh-2"));
    EXPECT_EQ(free_run_folder(tmp.path(), base_options(), "-0"), name("diffuse-sh-1"));
}

TEST(LogLevel, QuietBeatsVerbose) {
    TrainOptions options;
    EXPECT_EQ(shown_messages(options), LogLevel::kInfo);
    options.verbose = true;
    EXPECT_EQ(shown_messages(options), LogLevel::kDebug);
    options.quiet = true;
    EXPECT_EQ(shown_messages(options), LogLevel::kWarn);
}

}  // namespace
}  // namespace gs
