// SPDX-License-Identifier: Apache-2.0
// Where the secret of the ranks comes from, and which are refused.
#include "lib/group/secret.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <thread>

#include "kernels/base/error.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

class Secret : public ::testing::Test {
  protected:
    Secret() {
        std::string name = (fs::temp_directory_path() / "gsapp_secret_XXXXXX").string();
        if (!::mkdtemp(name.data())) throw std::runtime_error("no temporary folder");
        home = name;
        variables["HOME"] = name;
    }
    ~Secret() override { fs::remove_all(home); }

    std::string find() const {
        return shared_secret([this](const char* name) {
            const auto found = variables.find(name);
            return found == variables.end() ? nullptr : found->second.c_str();
        });
    }
    void expect_refused(const std::string& because) const {
        try {
            find();
            ADD_FAILURE() << "it should be refused";
        } catch (const UsageError& e) {
            EXPECT_NE(std::string(e.what()).find(because), std::string::npos) << e.what();
        }
    }

    fs::path home;
    std::map<std::string, std::string> variables;
};

TEST_F(Secret, ComesFromTheEnvironment) {
    variables[kSecretVariable] = " 0123456789abcdef\n";
    EXPECT_EQ(find(), "0123456789abcdef");
    EXPECT_TRUE(fs::is_empty(home));
    variables[kSecretVariable] = "0123456789";
    expect_refused("environment variable GSAPP_RANK_SECRET: a secret of 10 characters can be guessed");
    variables[kSecretVariable] = "";
    expect_refused("environment variable GSAPP_RANK_SECRET: a secret of 0 characters can be guessed");
}

TEST_F(Secret, IsMadeOnceInAFileThatOnlyItsUserReads) {
    std::set<std::string> found;
    std::mutex mutex;
    std::vector<std::thread> ranks;
    for (int k = 0; k < 8; ++k)
        ranks.emplace_back([&] {
            const std::string secret = find();
            const std::lock_guard lock(mutex);
            found.insert(secret);
        });
    for (std::thread& rank : ranks) rank.join();
    ASSERT_EQ(found.size(), 1u) << "all ranks have the same";
    EXPECT_EQ(found.begin()->size(), 64u);
    EXPECT_EQ(find(), *found.begin());
    const fs::path folder = home / ".config" / "gsapp";
    EXPECT_EQ(fs::status(folder / "rank_secret").permissions(), fs::perms::owner_read | fs::perms::owner_write);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), {}), 1) << "nothing else is left there";
    variables["XDG_CONFIG_HOME"] = (home / "elsewhere").string();
    EXPECT_NE(find(), *found.begin());
    EXPECT_TRUE(fs::exists(home / "elsewhere" / "gsapp" / "rank_secret"));
}

TEST_F(Secret, IsRefusedIfOthersMayKnowIt) {
    find();
    const fs::path file = home / ".config" / "gsapp" / "rank_secret";
    ::chmod(file.c_str(), 0640);
    expect_refused(file.string() + ": other users may read or write it (mode 640)");
    ::chmod(file.c_str(), 0600);
    std::ofstream(file) << "short\n";
    expect_refused(file.string() + ": a secret of 5 characters can be guessed");
    fs::remove(file);
    fs::create_directory(file);
    expect_refused(file.string() + ": it is no regular file");
}

TEST_F(Secret, IsAskedForIfItCannotBeKept) {
    std::ofstream(home / ".config") << "a file";
    expect_refused("set GSAPP_RANK_SECRET to the same secret for all ranks");
    variables.erase("HOME");
    expect_refused("there is no HOME to keep one in: set GSAPP_RANK_SECRET");
}

TEST_F(Secret, IsNewEachTimeForRanksOfOneMachine) { EXPECT_NE(random_secret(), random_secret()); }

}  // namespace
}  // namespace gs
