// SPDX-License-Identifier: Apache-2.0
// What torchrun and srun put into the environment, and what goes wrong with it.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <atomic>
#include <map>
#include <thread>
#include <vector>

#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "lib/group/rank_place.h"
#include "lib/group/rank_port.h"
#include "lib/group/secret.h"

namespace gs {
namespace {

using Variables = std::map<std::string, std::string>;
using Call = RankRequest::Call;
using Status = RankAnswer::Status;

std::optional<RankPlace> place(const Variables& variables) {
    return rank_place([&](const char* name) {
        const auto found = variables.find(name);
        return found == variables.end() ? nullptr : found->second.c_str();
    });
}

std::string error_of(const Variables& variables) {
    try {
        place(variables);
    } catch (const UsageError& e) {
        return e.what();
    }
    return "no error";
}

TEST(RankPlace, OfAProcessAloneIsNone) {
    EXPECT_FALSE(place({}));
    EXPECT_FALSE(place({{"WORLD_SIZE", "1"}, {"RANK", "0"}, {"SLURM_STEP_NUM_TASKS", "8"}, {"SLURM_PROCID", "3"}}));
    EXPECT_FALSE(place({{"SLURM_STEP_NUM_TASKS", "1"}}));
    EXPECT_FALSE(place({{"SLURM_NTASKS", "8"}, {"SLURM_PROCID", "0"}})) << "a batch script is no step of srun";
}

TEST(RankPlace, IsWhatTorchrunSays) {
    const auto p = place({{"RANK", "5"},
                          {"WORLD_SIZE", "8"},
                          {"LOCAL_RANK", "1"},
                          {"LOCAL_WORLD_SIZE", "4"},
                          {"MASTER_ADDR", "node7"},
                          {"MASTER_PORT", "29500"}});
    ASSERT_TRUE(p);
    EXPECT_EQ(p->rank, 5);
    EXPECT_EQ(p->size, 8);
    EXPECT_EQ(p->local_rank, 1);
    EXPECT_EQ(p->local_size, 4);
    EXPECT_EQ(p->master, "node7");
    EXPECT_EQ(p->port, 29500);
    const auto beside_store = [](const char* port) {
        return place({{"RANK", "1"},
                      {"WORLD_SIZE", "2"},
                      {"MASTER_ADDR", "node7"},
                      {"MASTER_PORT", port},
                      {"TORCHELASTIC_USE_AGENT_STORE", "True"}})
            ->port;
    };
    EXPECT_EQ(beside_store("29500"), 29501) << "torchrun's own store listens at the port that it names";
    EXPECT_EQ(beside_store("65535"), 65534);
    EXPECT_EQ(p->port, 29500);
}

TEST(RankPlace, IsWhatSrunSays) {
    Variables slurm = {{"SLURM_STEP_NUM_TASKS", "6"},
                       {"SLURM_PROCID", "4"},
                       {"SLURM_LOCALID", "0"},
                       {"SLURM_STEP_TASKS_PER_NODE", "4,2"},
                       {"SLURM_STEP_NODELIST", "gpu[03-04]"},
                       {"SLURM_JOB_ID", "1234567"}};
    auto p = place(slurm);
    ASSERT_TRUE(p);
    EXPECT_EQ(p->rank, 4);
    EXPECT_EQ(p->size, 6);
    EXPECT_EQ(p->local_size, 4);
    EXPECT_EQ(p->master, "gpu03");
    EXPECT_EQ(p->port, 24567);
    slurm["MASTER_ADDR"] = "10.0.0.7", slurm["MASTER_PORT"] = "4000";
    p = place(slurm);
    EXPECT_EQ(p->master, "10.0.0.7");
    EXPECT_EQ(p->port, 4000);
}

TEST(RankPlace, NamesVariableAndValueOfAMistake) {
    const Variables good = {{"RANK", "1"}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "a"}, {"MASTER_PORT", "1"}};
    const auto with = [&](const std::string& name, const std::string& value) {
        Variables changed = good;
        changed[name] = value;
        if (value.empty()) changed.erase(name);
        return error_of(changed);
    };
    EXPECT_EQ(error_of(good), "no error");
    EXPECT_NE(with("WORLD_SIZE", "two").find("WORLD_SIZE: 'two'"), std::string::npos);
    EXPECT_NE(with("WORLD_SIZE", "0").find("WORLD_SIZE: '0'"), std::string::npos);
    EXPECT_NE(with("RANK", "2").find("RANK: 2 is not below"), std::string::npos);
    EXPECT_NE(with("RANK", "-1").find("RANK: '-1'"), std::string::npos);
    EXPECT_NE(with("RANK", "").find("RANK is missing"), std::string::npos);
    EXPECT_NE(with("MASTER_ADDR", "").find("MASTER_ADDR is missing"), std::string::npos);
    EXPECT_NE(with("MASTER_PORT", "70000").find("MASTER_PORT: '70000'"), std::string::npos);
    EXPECT_NE(error_of({{"SLURM_STEP_NUM_TASKS", "2"}, {"SLURM_PROCID", "0"}}).find("MASTER_ADDR"), std::string::npos);
}

TEST(RankPlace, FirstMachineOfAList) {
    EXPECT_EQ(first_of_node_list("gpu1"), "gpu1");
    EXPECT_EQ(first_of_node_list("gpu1,gpu2"), "gpu1");
    EXPECT_EQ(first_of_node_list("node[03-07,9],gpu1"), "node03");
    EXPECT_EQ(first_of_node_list("a[5,7]"), "a5");
    EXPECT_EQ(first_of_node_list("login,node[03-07]"), "login");
    EXPECT_EQ(first_of_node_list("a["), "a");
    EXPECT_EQ(first_of_node_list(""), "");
}

// Ranks answer those of their job, whatever strangers send to their ports.

const Credentials kJob{"a secret of the two ranks", "2 ranks: train output/scene"};
/// Rank 0 must answer long before any stranger's time is over.
constexpr double kAtOnce = kAnswerSeconds / 2;

/// A connection without credentials.
class Stranger {
  public:
    explicit Stranger(int port) : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        sockaddr_in to{};
        to.sin_family = AF_INET, to.sin_port = htons(std::uint16_t(port)), to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        if (::connect(socket_.fd(), reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0)
            throw std::runtime_error("cannot connect");
    }
    explicit Stranger(Descriptor socket) : socket_(std::move(socket)) {}
    void send(const std::string& bytes) const { ::send(socket_.fd(), bytes.data(), bytes.size(), MSG_NOSIGNAL); }
    /// Returns so many bytes, or fewer if the other side closes the connection or is silent for `seconds`.
    std::string read(std::size_t size, double seconds = 30) const {
        std::string bytes;
        const double end = seconds_now() + seconds;
        while (bytes.size() < size && seconds_now() < end) {
            pollfd waits{socket_.fd(), POLLIN, 0};
            if (::poll(&waits, 1, 20) <= 0) continue;
            char byte = 0;
            if (::recv(socket_.fd(), &byte, 1, 0) <= 0) break;
            bytes += byte;
        }
        return bytes;
    }
    bool is_closed_within(double seconds) const {
        const double end = seconds_now() + seconds;
        read(std::size_t(1) << 20, seconds);
        return seconds_now() < end;
    }

  private:
    Descriptor socket_;
};

/// A port of a stranger that takes the place of a rank's.
class StrangersPort {
  public:
    StrangersPort() : listening_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
        sockaddr_in at{};
        at.sin_family = AF_INET, at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof at;
        if (::bind(listening_.fd(), reinterpret_cast<const sockaddr*>(&at), size) != 0 ||
            ::listen(listening_.fd(), 5) != 0 ||
            ::getsockname(listening_.fd(), reinterpret_cast<sockaddr*>(&at), &size) != 0)
            throw std::runtime_error("cannot listen");
        port_ = ntohs(at.sin_port);
    }
    int port() const { return port_; }
    Stranger accept() const { return Stranger(Descriptor(::accept(listening_.fd(), nullptr, nullptr))); }

  private:
    Descriptor listening_;
    int port_ = 0;
};

/// Rank 0 of two.
class RankPortTest : public ::testing::Test {
  protected:
    Roster roster{2};
    RankPort rank_0{"127.0.0.1", 0, 0, 2, kJob, answers_of(roster)};
    RosterClient rank_1{1, "127.0.0.1", rank_0.port(), kJob};

    /// Rank 1 is answered at once, and no failure was noted.
    void expect_at_work() {
        const double start = seconds_now();
        EXPECT_EQ(rank_1.report("here", 0), "");
        rank_1.set("key", {'y'});
        EXPECT_EQ(rank_1.get("key"), std::vector<char>{'y'});
        Descriptor connection;
        EXPECT_EQ(ask({0, "127.0.0.1", rank_0.port()}, {Call::kConnect, 1, "", ""}, kJob, 0, &connection).status,
                  Status::kOk);
        EXPECT_TRUE(rank_0.take(1, kAtOnce));
        EXPECT_LT(seconds_now() - start, kAtOnce);
        EXPECT_EQ(roster.failure(), "");
    }
};

TEST_F(RankPortTest, ConnectsRanks) {
    EXPECT_FALSE(rank_0.take(1, 0.01));
    Descriptor there;
    EXPECT_EQ(ask({0, "127.0.0.1", rank_0.port()}, {Call::kConnect, 1, "", ""}, kJob, 0, &there).status, Status::kOk);
    auto here = rank_0.take(1, 30);
    ASSERT_TRUE(here);
    EXPECT_FALSE(rank_0.take(1, 0.01)) << "it was taken";
    const Stranger one(std::move(there)), other(std::move(*here));
    one.send("there and");
    EXPECT_EQ(other.read(9), "there and");
    other.send("back");
    EXPECT_EQ(one.read(4), "back");
}

TEST_F(RankPortTest, StrangersBytesHaveNoEffect) {
    std::string garbage;
    for (int k = 0; k < 100000; ++k) garbage += char(k * k % 251);
    std::vector<Stranger> strangers;
    for (const std::string& bytes :
         {std::string("x"), std::string(1, '\0'), garbage, std::string(100000, '\xff'), std::string(100000, '\0'),
          std::string("POST /failed HTTP/1.1\r\nHost: x\r\nContent-Length: 4\r\n\r\nover"),
          std::string("\x10\0\0\0", 4) + std::string(32, 'n') + "half of a request"}) {
        strangers.emplace_back(rank_0.port()).send(bytes);
        Stranger(rank_0.port()).send(bytes);  // leaves at once
        expect_at_work();
    }
}

TEST_F(RankPortTest, IdleConnectionsKeepNobodyWaiting) {
    std::vector<Stranger> idle;
    for (int k = 0; k < 40; ++k) idle.emplace_back(rank_0.port());
    expect_at_work();
    for (int k = 0; k < 160; ++k) idle.emplace_back(rank_0.port());
    expect_at_work();
    EXPECT_TRUE(idle.front().is_closed_within(kAtOnce)) << "there are not more than some dozens at once";
    EXPECT_FALSE(idle.back().is_closed_within(0.1));
}

TEST_F(RankPortTest, NobodyWaitsForWhoStalls) {
    const Stranger idle(rank_0.port()), half(rank_0.port());
    half.send(std::string("\x10\0\0\0", 4) + std::string(32, 'n') + "half");
    const StrangersPort port;
    std::thread asks([&] {
        const double start = seconds_now();
        try {
            ask({0, "127.0.0.1", port.port()}, {Call::kReport, 1, "", ""}, kJob, 0);
            ADD_FAILURE() << "nobody answered";
        } catch (const DeviceError& e) {
            EXPECT_NE(std::string(e.what()).find("rank 1 cannot reach rank 0"), std::string::npos) << e.what();
        }
        EXPECT_LT(seconds_now() - start, 3 * kAnswerSeconds);
    });
    const Stranger rank = port.accept();
    rank.send("gsapp r1 and");
    EXPECT_TRUE(idle.is_closed_within(3 * kAnswerSeconds));
    EXPECT_TRUE(half.is_closed_within(3 * kAnswerSeconds));
    asks.join();
    expect_at_work();
}

TEST_F(RankPortTest, OnlyTheSecretMakesARank) {
    const auto refused = [&](const Credentials& other, const std::string& message) {
        for (const Call call : {Call::kSet, Call::kGet, Call::kReport, Call::kFail, Call::kConnect}) {
            Descriptor connection;
            try {
                ask({0, "127.0.0.1", rank_0.port()}, {call, 1, "key", "forged"}, other, 5, &connection);
                ADD_FAILURE() << "it is of another job";
            } catch (const DeviceError& e) {
                EXPECT_NE(std::string(e.what()).find(message), std::string::npos) << e.what();
            }
        }
        EXPECT_FALSE(rank_0.take(1, 0.01));
        EXPECT_FALSE(roster.get("key", 0.01));
        EXPECT_EQ(roster.failure(), "");
    };
    refused({"another secret of this job", kJob.job}, "rank 1 found ranks with another secret at 127.0.0.1 port");
    refused({"", kJob.job}, "rank 1 found ranks with another secret at 127.0.0.1 port");
    refused({kJob.secret, "2 ranks: train output/other"}, "rank 1 found another job at 127.0.0.1 port");
    expect_at_work();
}

TEST_F(RankPortTest, ARecordedRequestIsWorthNothing) {
    // A stranger between the ranks records what they say.
    const StrangersPort between;
    std::string of_rank_0, of_rank_1;
    std::thread asks([&] { RosterClient(1, "127.0.0.1", between.port(), kJob).set("key", {'1'}); });
    {
        const Stranger to_rank_1 = between.accept(), to_rank_0(rank_0.port());
        of_rank_0 = to_rank_0.read(40);
        to_rank_1.send(of_rank_0);
        while (!roster.get("key", 0)) {
            const std::string byte = to_rank_1.read(1, 0.05);
            to_rank_0.send(byte);
            of_rank_1 += byte;
        }
        const std::string answer = to_rank_0.read(1000);
        to_rank_1.send(answer);
        of_rank_0 += answer;
        asks.join();
    }
    EXPECT_EQ(roster.get("key", 0), std::vector<char>{'1'});
    roster.set("key", {'2'});
    const Stranger replays(rank_0.port());
    replays.send(of_rank_1);
    EXPECT_EQ(replays.read(1000).substr(40), std::string(1, char(Status::kRefused)));
    EXPECT_EQ(roster.get("key", 0), std::vector<char>{'2'});
    // Nor is a recorded answer.
    std::thread asks_again(
        [&] { EXPECT_THROW(RosterClient(1, "127.0.0.1", between.port(), kJob).set("key", {'1'}), DeviceError); });
    between.accept().send(of_rank_0);
    asks_again.join();
}

}  // namespace
}  // namespace gs
