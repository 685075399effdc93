// SPDX-License-Identifier: Apache-2.0
// Amounts of memory, nearest names, interrupts, version text and the log file.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <csignal>
#include <fstream>

#include "kernels/core/error.h"
#include "lib/core/bytes.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/nearest.h"
#include "lib/core/version.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TEST(Bytes, UnitsAreBinaryOrDecimal) {
    EXPECT_EQ(parse_bytes("4GiB"), std::uint64_t(4) << 30);
    EXPECT_EQ(parse_bytes("1.5 MiB"), 1572864u);
    EXPECT_EQ(parse_bytes("2MB"), 2000000u);
    EXPECT_EQ(parse_bytes("7"), 7u);
    EXPECT_EQ(parse_bytes("0"), 0u);
    for (const char* bad : {"", "GiB", "-1", "1 apple", "1e30GiB", "nan", "inf"})
        EXPECT_THROW(parse_bytes(bad), UsageError) << bad;
}

TEST(Nearest, FindsTheLeastEdited) {
    EXPECT_EQ(nearest_key("--itertions", {"--eval", "--iterations", "--test-iterations"}), "--iterations");
    EXPECT_EQ(nearest_key("cap_max", {"cap-max", "seed"}), "cap-max");
}

TEST(Interrupt, FirstSignalOnlySetsTheFlag) {
    catch_interrupts();
    EXPECT_FALSE(interrupted());
    std::raise(SIGTERM);
    EXPECT_TRUE(interrupted());
    catch_interrupts();
    EXPECT_FALSE(interrupted());
}

TEST(Interrupt, AClosedTerminalStopsTheRunUnlessItIsToOutliveIt) {
    catch_interrupts();
    std::raise(SIGHUP);
    EXPECT_TRUE(interrupted());
    std::signal(SIGHUP, SIG_IGN);  // as nohup does
    catch_interrupts();
    std::raise(SIGHUP);
    EXPECT_FALSE(interrupted());
    std::raise(SIGTERM);
    std::raise(SIGHUP);
    EXPECT_TRUE(interrupted()) << "still here";
    std::signal(SIGHUP, SIG_DFL);
}

TEST(Interrupt, SecondSignalEndsTheProgram) {
    EXPECT_EXIT(
        {
            catch_interrupts();
            std::raise(SIGINT);
            std::raise(SIGINT);
        },
        testing::KilledBySignal(SIGINT), "");
}

TEST(Version, NamesTheProgram) {
    EXPECT_EQ(version_text().rfind("gsapp ", 0), 0u);
    EXPECT_NE(version_text().find(version()), std::string::npos);
}

TEST(Log, MessagesReachTheFileByLevel) {
    test::TemporaryFolder folder;
    setup_log(LogLevel::kWarn);
    add_log_file(folder.path() / "gsapp.log");
    log_info("not this");
    log_warning("but this");
    spdlog::default_logger()->flush();
    std::ifstream file(folder.path() / "gsapp.log");
    const std::string text((std::istreambuf_iterator<char>(file)), {});
    EXPECT_EQ(text.find("not this"), std::string::npos);
    EXPECT_NE(text.find("warning: but this"), std::string::npos) << text;
    folder.write("file", "");
    EXPECT_THROW(add_log_file(folder.path() / "file" / "gsapp.log"), DataError);
}

}  // namespace
}  // namespace gs
