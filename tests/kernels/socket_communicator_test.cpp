// SPDX-License-Identifier: Apache-2.0
// Arrays of any size pass between ranks, and no rank waits for one that is gone.
#include "kernels/ranks/socket_communicator.h"

#include <gtest/gtest.h>

#include "kernels/base/error.h"
#include "tests/kernels/rank_threads.h"

namespace gs::test {
namespace {

template <class Fn> void expect_error(const std::string& message, Fn&& call) {
    try {
        call();
        ADD_FAILURE() << "it should fail";
    } catch (const DeviceError& e) {
        EXPECT_NE(std::string(e.what()).find(message), std::string::npos) << e.what();
    }
}

TEST(SocketCommunicator, ExchangesArraysThatNoSocketHolds) {
    on_ranks(4, [](Communicator& ranks) {
        const auto size_from_to = [](int from, int to) {
            return std::size_t(from == to ? 3 : (from + to) % 3 * 7654321);
        };
        for (int round = 0; round < 2; ++round) {
            std::vector<std::vector<char>> sent(4), received(4);
            std::vector<ConstBytes> out;
            std::vector<Bytes> in;
            for (int r = 0; r < 4; ++r) {
                sent[std::size_t(r)].assign(size_from_to(ranks.rank(), r), char(10 * ranks.rank() + r + round));
                received[std::size_t(r)].resize(size_from_to(r, ranks.rank()));
                out.push_back(bytes_of(sent[std::size_t(r)])), in.push_back(room_of(received[std::size_t(r)]));
            }
            ranks.exchange(out, in);
            for (int r = 0; r < 4; ++r)
                EXPECT_EQ(received[std::size_t(r)],
                          std::vector<char>(size_from_to(r, ranks.rank()), char(10 * r + ranks.rank() + round)));
        }
    });
}

TEST(SocketCommunicator, FailsWhenAnotherRankIsGone) {
    auto sockets = sockets_between(3);
    const auto ranks = connect_by_sockets(0, std::move(sockets[0]));
    sockets[2].clear();
    std::vector<char> byte(1);
    expect_error("rank 2 has closed the connection", [&] { ranks->exchange({{}, {}, {}}, {{}, {}, room_of(byte)}); });
    expect_error("the connection to rank 2 is lost", [&] { ranks->exchange({{}, {}, bytes_of(byte)}, {{}, {}, {}}); });
}

TEST(SocketCommunicator, FailsWhenItIsAborted) {
    auto sockets = sockets_between(2);
    const auto ranks = connect_by_sockets(0, std::move(sockets[0]));
    std::thread aborts([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
        ranks->abort();
    });
    std::vector<char> byte(1);
    for (int k = 0; k < 2; ++k)
        expect_error("the connection to the other ranks was ended", [&] {
            ranks->exchange({{}, {}}, {{}, room_of(byte)});
        });
    aborts.join();
}

TEST(SocketCommunicator, FailsWhenRanksExpectArraysOfOtherSizes) {
    on_ranks(2, [](Communicator& ranks) {
        std::vector<char> bytes(ranks.rank() == 0 ? 5 : 7);
        if (ranks.rank() == 1) return ranks.exchange({bytes_of(bytes), {}}, {{}, {}});
        expect_error("rank 1 has sent 7 bytes where 5 were expected", [&] {
            ranks.exchange({{}, {}}, {{}, room_of(bytes)});
        });
    });
}

}  // namespace
}  // namespace gs::test
