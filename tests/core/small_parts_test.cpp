// SPDX-License-Identifier: Apache-2.0
// Amounts of memory, durations, nearest names, JSON that is refused, interrupts, other programs, version text and the
// log file.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <set>
#include <vector>

#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/core/nearest.h"
#include "lib/core/process.h"
#include "lib/core/quantities.h"
#include "lib/core/utf8.h"
#include "lib/core/version.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TEST(Bytes, UnitsAreBinaryOrDecimal) {
    for (const auto& [text, count] : {std::pair<const char*, std::uint64_t>{"0", 0},
                                      {"7B", 7},
                                      {"4GiB", std::uint64_t(4) << 30},
                                      {"4g", std::uint64_t(4) << 30},
                                      {" 500 MB ", 500000000},
                                      {"1.5KiB", 1536},
                                      {"1.5 MiB", 1572864},
                                      {"2TiB", std::uint64_t(2) << 40}})
        EXPECT_EQ(parse_bytes(text, "").count, count) << text;
}

TEST(Bytes, NonsenseIsAUsageErrorNamingIt) {
    for (const char* text : {"", "GiB", "-1", "7", "123", "4 apples", "4GiBs", "1e9999", "1e30GiB", "nan", "inf",
                             "1,5G", "99999999999TiB", "4kb5"}) {
        try {
            parse_bytes(text, "");
            ADD_FAILURE() << text << " was accepted";
        } catch (const UsageError& error) {
            EXPECT_NE(std::string(error.what()).find("'" + std::string(text) + "'"), std::string::npos) << error.what();
        }
    }
}

TEST(Bytes, AreWrittenAsTheyAreRead) {
    for (const char* text : {"0", "7B", "1KiB", "500MB", "4GiB"}) EXPECT_EQ(parse_bytes(text, "").text(), text);
    EXPECT_EQ(parse_bytes("1024MiB", "").text(), "1GiB");
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

// The nearest known name.

TEST(Nearest, SmallestEditDistanceWins) {
    const std::vector<std::string> keys = {"iterations", "sh-degree", "cap-max", "opacity-lr"};
    EXPECT_EQ(nearest_key("iteration", keys), "iterations");
    EXPECT_EQ(nearest_key("itreations", keys), "iterations");
    EXPECT_EQ(nearest_key("SH_DEGREE", keys), "sh-degree");
    EXPECT_EQ(nearest_key("capmx", keys), "cap-max");
    EXPECT_EQ(nearest_key("ab", {"aa", "bb"}), "aa") << "the first of equally near ones";
    EXPECT_EQ(nearest_key("acb", {"abcd", "abc"}), "abc") << "a swap of neighbours costs one";
    EXPECT_EQ(nearest_key("x", {}), "");
}

TEST(Nearest, WhatIsFarIsNoSuggestion) {
    EXPECT_EQ(nearest_key("--feature-lr", {"--test-every", "--far-rate"}), "");
    EXPECT_EQ(nearest_key("--antialias", {"--axes", "--images"}), "");
    EXPECT_EQ(did_you_mean("--frobnicate", {"--format", "--device"}), "");
    EXPECT_EQ(did_you_mean("--frmat", {"--format", "--device"}), "; did you mean '--format'?");
}

TEST(Duration, ReadsNumbersWithUnits) {
    EXPECT_EQ(parse_duration("90s", "x").seconds, 90);
    EXPECT_EQ(parse_duration("2ms", "x").seconds, 0.002);
    EXPECT_EQ(parse_duration("20m", "x").seconds, 1200);
    EXPECT_EQ(parse_duration("20min", "x").seconds, 1200);
    EXPECT_EQ(parse_duration("1h30m", "x").seconds, 5400);
    EXPECT_EQ(parse_duration("0.5h", "x").seconds, 1800);
}

TEST(Duration, IsWrittenAsItIsRead) {
    for (const char* text : {"2ms", "90s", "20m", "0.7s", "1.5ms"})
        EXPECT_EQ(parse_duration(text, "x"), parse_duration(parse_duration(text, "x").text(), "x")) << text;
    EXPECT_EQ(parse_duration("1h30m", "x").text(), "90m");
}

TEST(Duration, NamesPlaceAndTextOfAnythingElse) {
    for (const char* text :
         {"", "m", "20x", "-5s", "0s", "1h30", "30 m", "nan", "inf", "1e3s", "s20", "99999h", "1.2.3s"}) {
        try {
            parse_duration(text, "--time-limit");
            ADD_FAILURE() << text;
        } catch (const UsageError& e) {
            EXPECT_NE(std::string(e.what()).find("--time-limit: '" + std::string(text) + "'"), std::string::npos)
                << e.what();
        }
    }
}

TEST(Duration, ANumberWithoutAUnitIsAskedForOne) {
    try {
        parse_duration("5", "option time-limit");
        ADD_FAILURE() << "5 was accepted";
    } catch (const UsageError& e) {
        EXPECT_STREQ(e.what(), "option time-limit: 5 of what? Write 5ms, 5s, 5m or 5h");
    }
}

TEST(Duration, IsWrittenInTheUnitsOfItsSize) {
    EXPECT_EQ(duration_text(3.21), "3.2 s");
    EXPECT_EQ(duration_text(725), "12 min 05 s");
    EXPECT_EQ(duration_text(9600), "2 h 40 min");
}

// JSON that would be taken for something else, or end the program, is refused.

std::string refusal(const std::string& text) {
    try {
        parse_json(text);
    } catch (const nlohmann::json::exception& e) {
        return e.what();
    }
    return "";
}

TEST(JsonText, KeysStandOnceInAnObject) {
    EXPECT_NE(refusal(R"({"a": 1, "b": {"a": 2, "a": 3}})").find("\"a\" stands twice"), std::string::npos);
    EXPECT_EQ(refusal(R"({"a": [{"a": 1}, {"a": 2}], "b": {"a": {}}})"), "");
    EXPECT_TRUE(try_parse_json(R"({"a": 1, "a": 2})").is_discarded());
}

TEST(JsonText, DeepNestingIsRefusedBeforeItOverflowsTheStack) {
    constexpr std::size_t kDeep = 300000;
    EXPECT_NE(refusal(std::string(kDeep, '[') + std::string(kDeep, ']')).find("nested deeper"), std::string::npos);
    EXPECT_TRUE(try_parse_ordered_json(std::string(kDeep, '[')).is_discarded());
    const std::string shallow = std::string(90, '[') + std::string(90, ']');
    EXPECT_EQ(json_text(parse_json(shallow)), shallow);
}

TEST(JsonText, LongListsTakeNoLongTime) {
    std::string text = "[{}";
    for (int i = 0; i < 200000; ++i) text += ",{}";
    EXPECT_EQ(parse_json(text + "]").size(), 200001u);
}

TEST(JsonText, CommentsAreTakenWhereTheyAreAllowed) {
    const std::string text = "{\"a\": 1 // one\n}";
    EXPECT_EQ(parse_json(text, true).at("a"), 1);
    EXPECT_THROW(parse_json(text), nlohmann::json::exception);
}

TEST(JsonText, NamesThatAreNotUtf8ComeBackByteForByte) {
    std::string all;
    for (int c = 1; c < 256; ++c) all += char(c);
    const std::vector<std::string> names = {"im\xE0",
                                            "im\xE1",
                                            "im\xEF\xBF\xBD",
                                            "caf\xC3\xA9\xE9",
                                            "\xED\xB3\xA0",
                                            "\\udce0",
                                            "\\\xE0",
                                            std::string("\0e0\xE0", 4),
                                            all};
    std::set<std::string> texts;
    for (const std::string& name : names) {
        nlohmann::ordered_json json = {{"image", name}, {"list", {1, name}}};
        json[name] = true;
        const std::string text = json_text(json, 1);
        EXPECT_TRUE(is_utf8(text)) << text;
        texts.insert(text);
        EXPECT_EQ(try_parse_ordered_json(text), json) << text;
        EXPECT_EQ(parse_json(text).at("image"), name);
    }
    EXPECT_EQ(texts.size(), names.size());
    EXPECT_EQ(json_text(nlohmann::json("im\xE0")), R"("im\udce0")") << "as Python's json.dumps writes os.fsdecode";
}

TEST(JsonText, PairsOfSurrogatesStayCharacters) {
    EXPECT_EQ(parse_json(R"("\ud83d\udc80 \uDCE9")"), "\xF0\x9F\x92\x80 \xE9");
    EXPECT_EQ(parse_json(R"("\\udce9")"), "\\udce9") << "an escaped backslash begins no escape";
    EXPECT_THROW(parse_json(R"("\ud83d")"), nlohmann::json::exception);
    EXPECT_THROW(parse_json(R"({"\udce9": 1, "\udcE9": 2})"), nlohmann::json::exception) << "one key, twice";
}

// Asking a program to stop; what it prints is tested with its users.

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
