// SPDX-License-Identifier: Apache-2.0
// Where the secret of the ranks comes from, and which are refused.
#include "lib/group/secret.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <thread>

#include "kernels/base/error.h"
#include "lib/group/rank_port.h"

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

// Values and failures that ranks share.

const Credentials kJob{"a secret of these tests", "2 ranks: train"};

std::vector<char> bytes(const std::string& text) { return {text.begin(), text.end()}; }

TEST(Roster, ValuesGoBothWays) {
    Roster roster(2);
    const RankPort server("127.0.0.1", 0, 0, roster.size(), kJob, answers_of(roster));
    RosterClient client(1, "127.0.0.1", server.port(), kJob);
    EXPECT_EQ(client.report("here", 5), "");
    client.set("a key/with ?&=% signs", bytes(std::string("\0\n\xff", 3)));
    EXPECT_EQ(roster.get("a key/with ?&=% signs", 5), bytes(std::string("\0\n\xff", 3)));
    std::thread late([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
        roster.set("late", bytes("value"));
    });
    EXPECT_EQ(client.get("late"), bytes("value"));
    late.join();
    EXPECT_FALSE(roster.get("never", 0.01));
}

TEST(Roster, TheFirstFailureIsToldToAll) {
    Roster roster(3);
    const RankPort server("127.0.0.1", 0, 0, roster.size(), kJob, answers_of(roster));
    RosterClient one(1, "127.0.0.1", server.port(), kJob), two(2, "127.0.0.1", server.port(), kJob);
    std::thread waits([&] {
        try {
            one.get("never");
            ADD_FAILURE() << "there is no such value";
        } catch (const DeviceError& e) {
            EXPECT_STREQ(e.what(), "rank 2 on x: no memory");
        }
    });
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    two.fail("rank 2 on x: no memory");
    waits.join();
    one.fail("another");
    EXPECT_EQ(one.report("here", 5), "rank 2 on x: no memory");
    EXPECT_EQ(roster.failure(), "rank 2 on x: no memory");
    EXPECT_FALSE(roster.get("never", 60));
}

TEST(Roster, RanksThatAreHeardOfAreNotLost) {
    Roster roster(2);
    roster.hear_of(1, "here");
    roster.hear_of(7, "nowhere");
    roster.look_for_lost_ranks();
    EXPECT_EQ(roster.failure(), "");
}

TEST(Roster, NobodyThereIsAnError) {
    int port = 0;
    {
        Roster roster(2);
        const RankPort server("127.0.0.1", 0, 0, roster.size(), kJob, answers_of(roster));
        port = server.port();
        EXPECT_THROW(RankPort("127.0.0.1", server.port(), 0, 2, kJob), DeviceError) << "another job has the port";
        EXPECT_THROW(RankPort("192.0.2.1", 0, 0, 2, kJob), DeviceError) << "no address of this machine";
    }
    RosterClient client(1, "127.0.0.1", port, kJob);
    try {
        client.report("here", 0.3);
        FAIL() << "nobody listens";
    } catch (const DeviceError& e) {
        EXPECT_NE(std::string(e.what()).find("rank 1 cannot reach rank 0 at 127.0.0.1 port"), std::string::npos);
    }
}

}  // namespace
}  // namespace gs
