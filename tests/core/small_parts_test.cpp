// SPDX-License-Identifier: Apache-2.0
// Amounts of memory, nearest names, interrupts, version text and the log file.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <csignal>
#include <cstdlib>
#include <fstream>

#include "kernels/base/error.h"
#include "lib/core/bytes.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/nearest.h"
#include "lib/core/utf8.h"
#include "lib/core/version.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TEST(Bytes, UnitsAreBinaryOrDecimal) {
    EXPECT_EQ(parse_bytes("4GiB"), std::uint64_t(4) << 30);
    EXPECT_EQ(parse_bytes("1.5 MiB"), 1572864u);
    EXPECT_EQ(parse_bytes("2MB"), 2000000u);
    EXPECT_EQ(parse_bytes("7B"), 7u);
    EXPECT_EQ(parse_bytes("0"), 0u);
    for (const char* bad : {"", "GiB", "-1", "7", "1 apple", "1e30GiB", "nan", "inf"})
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

TEST(Utf8, IsToldFromOtherBytes) {
    for (const char* text :
         {"", "plain", "\xC3\xA9", "\xE2\x82\xAC", "\xF0\x9F\x98\x80", "\xED\x9F\xBF", "\xF4\x8F\xBF\xBF"})
        EXPECT_TRUE(is_utf8(text)) << text;
    for (const char* text : {"\xE9", "\x80", "\xC3", "\xC0\x80", "\xE0\x80\x80", "\xED\xA0\x80", "\xF0\x80\x80\x80",
                             "\xF4\x90\x80\x80", "\xF5\x80\x80\x80", "a\xE2\x82", "\xC3\xA9\xFF"})
        EXPECT_FALSE(is_utf8(text)) << text;
}

TEST(Utf8, SpellingsOfOneNameAreBroughtTogether) {
    EXPECT_EQ(composed("Ku\xCC\x88"
                       "che"),
              "K\xC3\xBC"
              "che");
    EXPECT_EQ(case_folded("K\xC3\x9C"
                          "CHE.JPG"),
              "k\xC3\xBC"
              "che.jpg");
    EXPECT_EQ(composed("K\xFC"
                       "che"),
              "K\xFC"
              "che")
        << "bytes that are no UTF-8";
    EXPECT_EQ(case_folded("K\xDC"
                          "CHE"),
              "k\xDC"
              "che");
    EXPECT_TRUE(readings("abc").empty());
    ASSERT_FALSE(readings("\xBF\xCD\xCC\xFC").empty());
    EXPECT_EQ(readings("\xBF\xCD\xCC\xFC")[0].text, "\xE5\xAE\xA2\xE5\x8E\x85");
}

TEST(Log, AFullDiskIsSaidOnceAndEndsNothing) {
    ASSERT_EXIT(
        {
            setup_log(LogLevel::kWarn);
            add_log_file("/dev/full");
            for (int i = 0; i < 3; ++i) log_warning("message {}", i);
            std::exit(0);
        },
        testing::ExitedWithCode(0), "message 0\nwarning: .*/dev/full.*\nwarning: message 1\nwarning: message 2\n$");
}

TEST(Log, TheFileHasMoreThanIsShown) {
    test::TemporaryFolder folder;
    testing::internal::CaptureStderr();
    setup_log(LogLevel::kWarn);
    add_log_file(folder.path() / "gsapp.log");
    log_debug("but this");
    log_warning("and this");
    spdlog::default_logger()->flush();
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "warning: and this\n");
    std::ifstream file(folder.path() / "gsapp.log");
    const std::string text((std::istreambuf_iterator<char>(file)), {});
    EXPECT_NE(text.find("debug: but this"), std::string::npos) << text;
    EXPECT_NE(text.find("warning: and this"), std::string::npos) << text;
    folder.write("file", "");
    EXPECT_THROW(add_log_file(folder.path() / "file" / "gsapp.log"), DataError);
}

}  // namespace
}  // namespace gs
