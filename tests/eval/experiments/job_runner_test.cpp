// SPDX-License-Identifier: Apache-2.0
// Jobs trained by a program that only writes what a run leaves behind.
#include "eval/experiments/job_runner.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <atomic>
#include <fstream>
#include <iterator>
#include <map>
#include <stdexcept>
#include <thread>

#include "eval/experiments/job_claim.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Indices = std::vector<std::size_t>;
using namespace std::chrono_literals;

/// Writes the files of a finished run; fails where the folder's name ends with "broken", and leaves no scores where it
/// ends with "silent".
constexpr const char* kProgram = R"(#!/bin/sh
test "$1 $2 $4 $5" = "train --config --time-frames 1" || exit 1
model=$(sed -n 's/^model: *//p' "$3")
echo "called: $*" >> "${0%/*}/calls"
case "$model" in *slow*) sleep 0.2;; esac
case "$model" in *late*) sleep 1;; esac
case "$model" in *broken) echo "an error: the disk is full"; exit 3;; esac
mkdir -p "$model/point_cloud/iteration_20"
cp "$3" "$model/config.yaml"
case "$model" in *silent) exit 0;; esac
printf 0123456789 > "$model/point_cloud/iteration_20/point_cloud.ply"
echo '{"ours_20": {"PSNR": 20.5, "SSIM": 0.75}, "num_gaussians": {"ours_20": 123},
       "timing": {"ours_20": {"train_seconds": 4, "frame_seconds": 0.5}}}' > "$model/results.json"
)";

class JobRunnerTest : public ::testing::Test {
  protected:
    JobRunnerTest() {
        hooks_.program = tmp_.write("program", kProgram);
        fs::permissions(hooks_.program, fs::perms::owner_all);
        hooks_.done = [this](std::size_t k, const JobOutcome& outcome) {
            done_.push_back(k);
            outcomes_.push_back(outcome);
        };
    }
    Job job(const std::string& name) const {
        TrainOptions options;
        options.source = "builtin:diffuse";
        options.device = Device::kCpu;
        options.iterations = 20;
        options.eval = true;
        options.model = (tmp_.path() / name).string();
        options = resolve(options);
        return {name, options};
    }
    std::size_t num_calls() const {
        std::ifstream calls(tmp_.path() / "calls");
        return std::size_t(std::count(std::istreambuf_iterator<char>(calls), {}, '\n'));
    }
    bool called() const { return fs::exists(tmp_.path() / "calls"); }

    test::TemporaryFolder tmp_;
    JobHooks hooks_;
    Indices done_;
    std::vector<JobOutcome> outcomes_;
};

TEST_F(JobRunnerTest, TrainsJobsAndKeepsThoseThatAreFinished) {
    const std::vector<Job> jobs = {job("a"), job("b")};
    const JobsSummary summary = run_jobs(jobs, hooks_);
    EXPECT_EQ(summary.num_failed, 0);
    EXPECT_FALSE(summary.interrupted);
    ASSERT_EQ(done_, (Indices{0, 1}));
    ASSERT_TRUE(outcomes_[1].result) << outcomes_[1].error;
    EXPECT_EQ(outcomes_[1].result->psnr, 20.5);
    EXPECT_EQ(outcomes_[1].result->bytes, 10);
    EXPECT_TRUE(outcomes_[1].wall_seconds);
    EXPECT_NO_THROW(throw_unless_complete(summary, 2, "out/table.md"));

    fs::remove(tmp_.path() / "calls");
    run_jobs(jobs, hooks_);
    EXPECT_FALSE(called()) << "nothing is missing";
    ASSERT_EQ(outcomes_.size(), 4u);
    EXPECT_TRUE(outcomes_[3].result);
    EXPECT_FALSE(outcomes_[3].wall_seconds);

    std::vector<Job> again = jobs;
    for (Job& c : again) c.options.overwrite = true;
    run_jobs(again, hooks_);
    EXPECT_TRUE(called()) << "--overwrite trains all of them";
}

TEST_F(JobRunnerTest, AFailureDoesNotStopTheOthers) {
    const JobsSummary summary = run_jobs({job("broken"), job("silent"), job("good")}, hooks_);
    EXPECT_EQ(summary.num_failed, 2);
    EXPECT_EQ(summary.first_code, ExitCode::kDataset);
    ASSERT_EQ(done_, (Indices{0, 1, 2}));
    EXPECT_EQ(outcomes_[0].error, "the disk is full");
    EXPECT_NE(outcomes_[1].error.find("no scores"), std::string::npos) << outcomes_[1].error;
    EXPECT_TRUE(outcomes_[2].result);
    try {
        throw_unless_complete(summary, 3, "out/table.md");
        FAIL() << "two runs failed";
    } catch (const Error& e) {
        EXPECT_EQ(e.code(), ExitCode::kDataset);
        EXPECT_STREQ(e.what(), "2 of 3 runs failed; the messages are in out/table.md");
    }
}

TEST_F(JobRunnerTest, TheCallerChoosesTheOrderAndMayStop) {
    std::vector<Indices> asked;
    hooks_.choose = [&](const Indices& pending) {
        asked.push_back(pending);
        return pending.size() > 1 ? std::optional(pending.back()) : std::nullopt;
    };
    const JobsSummary summary = run_jobs({job("a"), job("b"), job("c")}, hooks_);
    EXPECT_EQ(done_, (Indices{2, 1}));
    EXPECT_EQ(asked, (std::vector<Indices>{{0, 1, 2}, {0, 1}, {0}}));
    EXPECT_EQ(summary.num_failed, 0) << "a job that was not reached has not failed";
}

TEST_F(JobRunnerTest, NothingStartsAfterTheDeadline) {
    hooks_.deadline = std::chrono::steady_clock::now();
    const JobsSummary summary = run_jobs({job("a")}, hooks_);
    EXPECT_FALSE(called());
    EXPECT_TRUE(done_.empty());
    EXPECT_FALSE(summary.interrupted);
}

TEST_F(JobRunnerTest, AnExceptionOfTheCallerEndsTheRuns) {
    hooks_.done = [](std::size_t, const JobOutcome&) { throw std::runtime_error("no space for the table"); };
    EXPECT_THROW(run_jobs({job("a"), job("b")}, hooks_), std::runtime_error);
    EXPECT_FALSE(fs::exists(tmp_.path() / "b"));
}

TEST_F(JobRunnerTest, SeveralCallersDivideTheJobsAndEachIsToldOfAll) {
    std::vector<Job> jobs;
    for (int k = 0; k < 6; ++k) jobs.push_back(job("slow" + std::to_string(k)));
    std::vector<std::map<std::size_t, JobOutcome>> told(3);
    std::vector<std::thread> callers;
    for (auto& mine : told)
        callers.emplace_back([&] {
            JobHooks hooks = hooks_;
            hooks.done = [&](std::size_t k, const JobOutcome& outcome) { mine[k] = outcome; };
            run_jobs(jobs, hooks);
        });
    for (std::thread& caller : callers) caller.join();
    EXPECT_EQ(num_calls(), jobs.size());
    int trained = 0;
    for (const auto& mine : told) {
        ASSERT_EQ(mine.size(), jobs.size());
        for (const auto& [k, outcome] : mine) {
            EXPECT_TRUE(outcome.result) << k << ": " << outcome.error;
            trained += outcome.wall_seconds.has_value();
        }
    }
    EXPECT_EQ(trained, 6);
    for (const auto& entry : fs::directory_iterator(tmp_.path()))
        EXPECT_NE(entry.path().extension(), ".claim") << entry.path();
}

TEST_F(JobRunnerTest, AFailedJobIsTriedOnceByAllAndAgainByALaterStart) {
    // Fast failures, which others meet while they train or wait, and one for which all wait.
    const std::vector<Job> jobs = {job("0broken"), job("slow1"), job("2broken"), job("slow3"), job("late_broken")};
    std::vector<std::map<std::size_t, JobOutcome>> told(3);
    std::vector<JobsSummary> summaries(3);
    const auto call_all = [&] {
        std::vector<std::thread> callers;
        for (std::size_t n = 0; n < told.size(); ++n)
            callers.emplace_back([&, n] {
                JobHooks hooks = hooks_;
                hooks.stale_after = std::chrono::seconds(3);  // renewed twice a second
                hooks.done = [&, n](std::size_t k, const JobOutcome& outcome) { told[n][k] = outcome; };
                // One that comes later is told, too, of what failed before it came.
                if (n == 2) std::this_thread::sleep_for(std::chrono::milliseconds(500));
                summaries[n] = run_jobs(jobs, hooks);
            });
        for (std::thread& caller : callers) caller.join();
    };
    call_all();
    EXPECT_EQ(num_calls(), jobs.size());
    for (std::size_t n = 0; n < told.size(); ++n) {
        ASSERT_EQ(told[n].size(), jobs.size());
        EXPECT_EQ(summaries[n].num_failed, 3);
        EXPECT_EQ(summaries[n].first_code, ExitCode::kDataset);
        for (const std::size_t k : {0, 2, 4}) EXPECT_EQ(told[n][k].error, "the disk is full") << k;
        for (const std::size_t k : {1, 3}) EXPECT_TRUE(told[n][k].result) << k;
    }
    fs::remove(tmp_.path() / "calls");
    call_all();
    EXPECT_EQ(num_calls(), 3u) << "each failed job is tried once more, by one of them";
    fs::remove(tmp_.path() / "calls");

    // What made them fail is mended.
    fs::permissions(
        tmp_.write("program", std::string(kProgram).replace(std::string(kProgram).find("*broken)"), 8, "*never)")),
        fs::perms::owner_all);
    call_all();
    EXPECT_EQ(num_calls(), 3u);
    for (const auto& mine : told) EXPECT_TRUE(mine.at(4).result) << mine.at(4).error;
    for (const auto& entry : fs::directory_iterator(tmp_.path())) {
        EXPECT_NE(entry.path().extension(), ".claim") << entry.path();
        EXPECT_NE(entry.path().extension(), ".failed") << entry.path();
    }
}

TEST_F(JobRunnerTest, SeveralCallersThatOverwriteTrainEachJobOnce) {
    std::vector<Job> jobs = {job("slow0"), job("slow1"), job("slow2")};
    run_jobs(jobs, hooks_);
    fs::remove(tmp_.path() / "calls");
    for (Job& c : jobs) c.options.overwrite = true;
    std::vector<std::size_t> told(2);
    std::vector<std::thread> callers;
    for (std::size_t& mine : told)
        callers.emplace_back([&] {
            JobHooks hooks = hooks_;
            hooks.done = [&](std::size_t, const JobOutcome& outcome) { mine += outcome.result.has_value(); };
            run_jobs(jobs, hooks);
        });
    for (std::thread& caller : callers) caller.join();
    EXPECT_EQ(num_calls(), jobs.size());
    EXPECT_EQ(told, (std::vector<std::size_t>{3, 3}));
}

TEST_F(JobRunnerTest, AJobWhoseProcessIsGoneIsTakenOver) {
    hooks_.stale_after = std::chrono::milliseconds(300);
    tmp_.write("a.claim", "another-machine/pid:[1] 77 1.1\n");
    const auto begin = std::chrono::steady_clock::now();
    run_jobs({job("a")}, hooks_);
    EXPECT_GE(std::chrono::steady_clock::now() - begin, hooks_.stale_after);
    EXPECT_EQ(num_calls(), 1u);
    ASSERT_EQ(outcomes_.size(), 1u);
    EXPECT_TRUE(outcomes_[0].result);
}

TEST(JobsSummary, AnInterruptNamesTheFolderToGoOnIn) {
    EXPECT_THROW(throw_unless_complete({.num_failed = 1, .first_code = ExitCode::kDevice, .interrupted = true}, 2,
                                       "out/table.md"),
                 Interrupted);
}

// Claims of processes that live, that are gone, and that were thought to be gone.

std::string text_of(const fs::path& file) {
    std::ifstream in(file);
    return {std::istreambuf_iterator<char>(in), {}};
}

TEST(JobClaim, OneAtATimeAndNoFileIsLeft) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.path() / "new" / "a.claim";
    JobClaims mine(60s), theirs(60s);
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

TEST(JobClaim, ThatIsRenewedIsHeldLongerThanASilentOne) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.path() / "a.claim";
    JobClaims mine(1500ms), theirs(1500ms);
    const auto claim = mine.take(file);
    const auto end = std::chrono::steady_clock::now() + 2500ms;
    while (std::chrono::steady_clock::now() < end) {
        ASSERT_TRUE(theirs.held(file));
        std::this_thread::sleep_for(20ms);
    }
}

TEST(JobClaim, OfAProcessOfThisMachineThatHasEndedIsTakenAtOnce) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.path() / "a.claim";
    const pid_t child = ::fork();
    if (child == 0) {  // ends without giving anything back, as if it were killed
        JobClaims claims(60s);
        const auto claim = claims.take(file);
        ::_exit(claim ? 0 : 1);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_EQ(status, 0);
    ASSERT_TRUE(fs::exists(file));
    JobClaims claims(60s);
    EXPECT_FALSE(claims.held(file));
    EXPECT_TRUE(claims.take(file));
}

TEST(JobClaim, OfSeveralThatTakeOverOneWins) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.write("a.claim", "another-machine/pid:[1] 77 1.1\n");
    std::atomic<int> winners{0}, ready{0}, looked{0};
    std::vector<std::thread> takers;
    for (int k = 0; k < 4; ++k)
        takers.emplace_back([&] {
            JobClaims claims(1000ms);
            claims.held(file);
            std::this_thread::sleep_for(1100ms);
            ++ready;
            while (ready < 4) std::this_thread::yield();
            const auto claim = claims.take(file);
            winners += claim != nullptr;
            for (++looked; looked < 4;) std::this_thread::yield();
        });
    for (std::thread& taker : takers) taker.join();
    EXPECT_EQ(winners, 1);
}

TEST(JobClaim, ThatAnotherTookIsLostAndLeftAlone) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.path() / "a.claim";
    const std::string other = "another-machine/pid:[1] 77 1.1\n";
    {
        JobClaims claims(120ms);
        const auto claim = claims.take(file);
        ASSERT_TRUE(claim);
        std::ofstream(file) << other;
        const auto end = std::chrono::steady_clock::now() + 100s;
        while (!claim->lost() && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(10ms);
        EXPECT_TRUE(claim->lost());
    }
    EXPECT_EQ(text_of(file), other);
}

TEST(JobClaim, WhatItTellsStaysWhenItEnds) {
    const test::TemporaryFolder tmp;
    const fs::path file = tmp.write("a.failed", "another-machine/pid:[1] 77 1.1\n3 of another time");
    EXPECT_EQ(read_note(tmp.path() / "none").text, "");
    const JobNote before = read_note(file);
    EXPECT_EQ(before.text, "3 of another time");
    const std::string long_note = "3 " + std::string(2000, 'x') + "\nand a second line";
    JobClaims mine(300ms), theirs(300ms);
    auto claim = mine.tell(file, long_note);
    const JobNote told = read_note(file);
    EXPECT_EQ(told.text, long_note);
    EXPECT_NE(told, before);
    const auto end = std::chrono::steady_clock::now() + 100s;
    while (read_note(file) == told && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(10ms);
    EXPECT_NE(read_note(file), told) << "renewed while its process is at work";
    EXPECT_FALSE(claim->lost());
    EXPECT_EQ(read_note(file).text, long_note);
    EXPECT_TRUE(theirs.held(file));
    claim.reset();
    EXPECT_EQ(read_note(file).text, long_note);
    EXPECT_FALSE(theirs.held(file));
}

TEST(JobClaim, AFolderThatCannotBeWrittenIsAnErrorThatNamesTheFile) {
    const test::TemporaryFolder tmp;
    const fs::path no_folder = tmp.write("file", "");
    JobClaims claims(60s);
    try {
        claims.take(no_folder / "a.claim");
        FAIL() << "took a claim below a file";
    } catch (const DataError& e) {
        EXPECT_NE(std::string(e.what()).find("a.claim"), std::string::npos) << e.what();
    }
}

}  // namespace
}  // namespace gs
