// SPDX-License-Identifier: Apache-2.0
// Inputs that fuzzing found end well, and so do valid ones and damaged ones. tests/fuzz/corpus/TARGET/ holds what was
// found; scripts/fuzz finds more.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iterator>

#include "tests/fuzz/target.h"

namespace gs::fuzz {

/// What GoogleTest calls a target.
void PrintTo(const Target& target, std::ostream* out);
void PrintTo(const Target& target, std::ostream* out) { *out << target.name; }

namespace {

namespace fs = std::filesystem;

// Limits of one input, all of which are below 1 MiB. Sanitizers make both some times larger than they are.
constexpr double kMostSeconds = 20;
constexpr long kMostKilobytes = 1 << 20;

class Corpus : public ::testing::TestWithParam<Target> {
  protected:
    /// Reads the input; a crash ends the program after it has printed which input it was.
    Ending expect_good_end(const std::string& bytes, const std::string& what) {
        std::printf("%s\n", what.c_str());
        std::fflush(stdout);
        const auto start = std::chrono::steady_clock::now();
        Ending ending = Ending::kRefused;
        try {
            ending = read(GetParam(), bytes, &reason_);
        } catch (const std::exception& error) {
            ADD_FAILURE() << what << ": " << error.what();
        }
        EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(), kMostSeconds)
            << what;
        rusage usage{};
        getrusage(RUSAGE_SELF, &usage);
        EXPECT_LT(usage.ru_maxrss, kMostKilobytes) << what << " or an earlier input took this many kilobytes";
        return ending;
    }
    std::string reason_;  ///< of the last refusal
};

TEST_P(Corpus, FoundInputsEndWell) {
    const fs::path folder = fs::path(GSAPP_SOURCE_DIR) / "tests/fuzz/corpus" / GetParam().name;
    std::vector<fs::path> files;
    if (fs::exists(folder)) files.assign(fs::directory_iterator(folder), {});
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) {
        std::ifstream in(file, std::ios::binary);
        expect_good_end({std::istreambuf_iterator<char>(in), {}}, file.filename().string());
    }
}

// A target whose seeds are refused would prove nothing.
TEST_P(Corpus, SeedsAreAccepted) {
    int number = 0;
    for (const std::string& bytes : GetParam().seeds()) {
        const std::string what = "seed " + std::to_string(number++);
        EXPECT_TRUE(expect_good_end(bytes, what) == Ending::kAccepted) << what << " is refused: " << reason_;
        for (const std::size_t part : {0, 1, 2, 3})
            expect_good_end(bytes.substr(0, bytes.size() * part / 4),
                            what + ", cut at quarter " + std::to_string(part));
    }
    EXPECT_GT(number, 0);
}

INSTANTIATE_TEST_SUITE_P(Fuzz, Corpus, ::testing::ValuesIn(targets()), [](const auto& info) {
    std::string name(info.param.name);
    std::replace(name.begin(), name.end(), '.', '_');
    return name;
});

}  // namespace
}  // namespace gs::fuzz
