// SPDX-License-Identifier: Apache-2.0
// Claims of processes that live, that are gone, and that were thought to be gone.
#include "eval/experiments/cell_claim.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <fstream>

#include "kernels/base/error.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

std::string text_of(const fs::path& file) {
    std::ifstream in(file);
    return {std::istreambuf_iterator<char>(in), {}};
}

TEST(CellClaim, OneAtATimeAndNoFileIsLeft) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.path() / "new" / "a.claim";
    CellClaims mine(60s), theirs(60s);
    EXPECT_FALSE(theirs.held(file));
    auto claim = mine.take(file);
    ASSERT_TRUE(claim);
    EXPECT_TRUE(theirs.held(file));
    EXPECT_FALSE(theirs.take(file));
    EXPECT_FALSE(claim->lost());
    claim.reset();
    EXPECT_FALSE(fs::exists(file));
    EXPECT_TRUE(theirs.take(file));
}

TEST(CellClaim, ThatIsRenewedIsHeldLongerThanASilentOne) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.path() / "a.claim";
    CellClaims mine(300ms), theirs(300ms);
    const auto claim = mine.take(file);
    const auto end = std::chrono::steady_clock::now() + 900ms;
    while (std::chrono::steady_clock::now() < end) {
        ASSERT_TRUE(theirs.held(file));
        std::this_thread::sleep_for(20ms);
    }
}

TEST(CellClaim, OfAProcessOfThisMachineThatHasEndedIsTakenAtOnce) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.path() / "a.claim";
    const pid_t child = ::fork();
    if (child == 0) {  // ends without giving anything back, as if it were killed
        CellClaims claims(60s);
        const auto claim = claims.take(file);
        ::_exit(claim ? 0 : 1);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_EQ(status, 0);
    ASSERT_TRUE(fs::exists(file));
    CellClaims claims(60s);
    EXPECT_FALSE(claims.held(file));
    EXPECT_TRUE(claims.take(file));
}

TEST(CellClaim, OfSeveralThatTakeOverOneWins) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.write("a.claim", "another-machine/pid:[1] 77 1.1\n");
    std::atomic<int> winners{0}, ready{0};
    std::vector<std::thread> takers;
    for (int k = 0; k < 4; ++k)
        takers.emplace_back([&] {
            CellClaims claims(200ms);
            claims.held(file);
            std::this_thread::sleep_for(250ms);
            ++ready;
            while (ready < 4) std::this_thread::yield();
            const auto claim = claims.take(file);
            winners += claim != nullptr;
            std::this_thread::sleep_for(700ms);  // until all have looked
        });
    for (std::thread& taker : takers) taker.join();
    EXPECT_EQ(winners, 1);
}

TEST(CellClaim, ThatAnotherTookIsLostAndLeftAlone) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.path() / "a.claim";
    const std::string other = "another-machine/pid:[1] 77 1.1\n";
    {
        CellClaims claims(120ms);
        const auto claim = claims.take(file);
        ASSERT_TRUE(claim);
        std::ofstream(file) << other;
        const auto end = std::chrono::steady_clock::now() + 10s;
        while (!claim->lost() && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(10ms);
        EXPECT_TRUE(claim->lost());
    }
    EXPECT_EQ(text_of(file), other);
}

TEST(CellClaim, WhatItTellsStaysWhenItEnds) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.write("a.failed", "another-machine/pid:[1] 77 1.1\n3 of another time");
    EXPECT_EQ(read_note(tmp.path() / "none").text, "");
    const CellNote before = read_note(file);
    EXPECT_EQ(before.text, "3 of another time");
    const std::string long_note = "3 " + std::string(2000, 'x') + "\nand a second line";
    CellClaims mine(300ms), theirs(300ms);
    auto claim = mine.tell(file, long_note);
    const CellNote told = read_note(file);
    EXPECT_EQ(told.text, long_note);
    EXPECT_NE(told, before);
    std::this_thread::sleep_for(200ms);
    EXPECT_FALSE(claim->lost());
    EXPECT_NE(read_note(file), told) << "renewed while its process is at work";
    EXPECT_EQ(read_note(file).text, long_note);
    EXPECT_TRUE(theirs.held(file));
    claim.reset();
    EXPECT_EQ(read_note(file).text, long_note);
    EXPECT_FALSE(theirs.held(file));
}

TEST(CellClaim, AFolderThatCannotBeWrittenIsAnErrorThatNamesTheFile) {
    const test::TemporaryFolder tmp;
    const fs::path no_folder = tmp.write("file", "");
    CellClaims claims(60s);
    try {
        claims.take(no_folder / "a.claim");
        FAIL() << "took a claim below a file";
    } catch (const DataError& e) {
        EXPECT_NE(std::string(e.what()).find("a.claim"), std::string::npos) << e.what();
    }
}

}  // namespace
}  // namespace gs
