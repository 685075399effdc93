// SPDX-License-Identifier: Apache-2.0
// Values and failures that ranks share over HTTP.
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "kernels/core/error.h"
#include "lib/ranks/roster.h"

namespace gs {
namespace {

std::vector<char> bytes(const std::string& text) { return {text.begin(), text.end()}; }

TEST(Roster, ValuesGoBothWays) {
    Roster roster(2);
    const RosterServer server(roster, "127.0.0.1", 0);
    RosterClient client(1, "127.0.0.1", server.port());
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
    const RosterServer server(roster, "127.0.0.1", 0);
    RosterClient one(1, "127.0.0.1", server.port()), two(2, "127.0.0.1", server.port());
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

TEST(Roster, RanksOfAnotherJobDoNotDisturb) {
    Roster roster(2);
    const RosterServer server(roster, "127.0.0.1", 0, "one");
    RosterClient own(1, "127.0.0.1", server.port(), "one"), other(1, "127.0.0.1", server.port(), "two");
    const auto refused = [](auto&& call) {
        try {
            call();
            ADD_FAILURE() << "it is of another job";
        } catch (const DeviceError& e) {
            EXPECT_NE(std::string(e.what()).find("rank 1 found another job at 127.0.0.1 port"), std::string::npos);
        }
    };
    refused([&] { other.report("elsewhere", 5); });
    refused([&] { other.set("key", bytes("wrong")); });
    refused([&] { other.get("key"); });
    refused([&] { other.fail("a failure of the other job"); });
    EXPECT_EQ(roster.failure(), "");
    EXPECT_EQ(own.report("here", 5), "");
    own.set("key", bytes("right"));
    EXPECT_EQ(own.get("key"), bytes("right"));
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
        const RosterServer server(roster, "127.0.0.1", 0);
        port = server.port();
        EXPECT_THROW(RosterServer(roster, "127.0.0.1", server.port()), DeviceError) << "another job has the port";
        EXPECT_THROW(RosterServer(roster, "192.0.2.1", 0), DeviceError) << "no address of this machine";
    }
    RosterClient client(1, "127.0.0.1", port);
    try {
        client.report("here", 0.3);
        FAIL() << "nobody listens";
    } catch (const DeviceError& e) {
        EXPECT_NE(std::string(e.what()).find("rank 1 cannot reach rank 0 at 127.0.0.1 port"), std::string::npos);
    }
}

}  // namespace
}  // namespace gs
