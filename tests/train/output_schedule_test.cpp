// SPDX-License-Identifier: Apache-2.0
// The iterations after which options ask for output.
#include "lib/train/output_schedule.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

OutputOptions options_with_everything() {
    OutputOptions options;
    options.preview_every = 50;
    options.test_iterations = {7, 120};
    options.save_iterations = {30};
    options.checkpoint_iterations = {31, 30};
    return options;
}

TEST(OutputSchedule, EveryKindOfOutputIsDue) {
    const OutputOptions options = options_with_everything();
    for (const std::int64_t iteration : {7, 30, 31, 50, 100, 120}) EXPECT_TRUE(output_is_due(options, iteration));
    for (const std::int64_t iteration : {1, 29, 32, 75, 121}) EXPECT_FALSE(output_is_due(options, iteration));
    EXPECT_FALSE(output_is_due({}, 100)) << "options that ask for nothing";
}

TEST(OutputSchedule, TheNextOutputIsTheFirstThatIsDueLater) {
    const OutputOptions options = options_with_everything();
    for (std::int64_t iteration = 0; iteration < 130; ++iteration) {
        std::int64_t next = iteration + 1;
        while (!output_is_due(options, next)) ++next;
        EXPECT_EQ(next_output(options, iteration), next);
    }
    EXPECT_EQ(next_output({}, 3), std::numeric_limits<std::int64_t>::max());
}

}  // namespace
}  // namespace gs
