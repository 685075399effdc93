// SPDX-License-Identifier: Apache-2.0
// Values and failures that ranks share.
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "kernels/base/error.h"
#include "lib/group/rank_port.h"

namespace gs {
namespace {

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
