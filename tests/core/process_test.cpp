// SPDX-License-Identifier: Apache-2.0
// Asking a program to stop; what it prints is tested with its users.
#include "lib/core/process.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>

#include "lib/core/interrupt.h"

namespace gs {
namespace {

bool contains(const ProcessResult& result, const std::string& line) {
    return std::find(result.last_lines.begin(), result.last_lines.end(), line) != result.last_lines.end();
}

TEST(Process, EndsByAClosedPipeThoughThisProgramDoesNot) {
    ignore_write_signals();
    const ProcessResult result = run_process({"sh", "-c", "kill -PIPE $$; echo still here"}, {}, [](const auto&) {});
    std::signal(SIGPIPE, SIG_DFL);
    std::signal(SIGXFSZ, SIG_DFL);
    EXPECT_EQ(result.exit_code, 128 + SIGPIPE);
}

TEST(Process, GetsOneInterruptAndMayEndInItsOwnWay) {
    bool ready = false;
    int asked = 0;
    const ProcessResult result = run_process(
        {"sh", "-c",
         "trap 'echo saving; sleep 0.3; echo saved; exit 130' INT; echo ready; while :; do sleep 0.05; done"},
        {}, [&](const std::string& line) { ready |= line == "ready"; },
        [&] {
            asked += ready;
            return ready;
        });
    EXPECT_EQ(result.exit_code, 130);
    EXPECT_TRUE(contains(result, "saved")) << "a second signal would have ended the sleep";
    EXPECT_EQ(asked, 1) << "once it said yes";
}

TEST(Process, IsLeftAloneWhileStopIsFalse) {
    const ProcessResult result = run_process(
        {"sh", "-c", "sleep 0.3; echo done"}, {}, [](const std::string&) {}, [] { return false; });
    EXPECT_EQ(result.exit_code, 0);
    EXPECT_TRUE(contains(result, "done"));
}

}  // namespace
}  // namespace gs
