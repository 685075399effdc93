// SPDX-License-Identifier: Apache-2.0
// Arrays of any size pass between ranks, and no rank waits for one that is gone.
#include "kernels/ranks/socket_communicator.h"

#include <gtest/gtest.h>
#include <numeric>

#include "kernels/base/error.h"
#include "kernels/ranks/communicator.h"
#include "tests/kernels/fake_device_stream.h"
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

// Arrays of ranks that lie on a device, and their way to others through the host.

TEST(DeviceArray, KeepsItsValuesWhereTheRankComputes) {
    FakeDevice device;
    for (DeviceStream* where : {static_cast<DeviceStream*>(nullptr), static_cast<DeviceStream*>(&device)}) {
        DeviceArray<int> array(where);
        std::vector<int> values(5), copy;
        std::iota(values.begin(), values.end(), 1);
        array.assign(values);
        EXPECT_EQ(array.device(), where);
        EXPECT_EQ(array.bytes(1, 3).size(), 2 * sizeof(int));
        const auto on_host = array.on_host(copy);
        EXPECT_EQ(std::vector<int>(on_host.begin(), on_host.end()), values);
        EXPECT_EQ(copy.empty(), where == nullptr) << "the host's are not copied";
        array.resize(0);
        EXPECT_TRUE(array.on_host(copy).empty());
        array.assign({});
        EXPECT_EQ(array.size(), 0u);
    }
}

TEST(DeviceArray, TakesThePlaceOfAnotherOnADeviceAlone) {
    FakeDevice device;
    for (DeviceStream* where : {static_cast<DeviceStream*>(nullptr), static_cast<DeviceStream*>(&device)}) {
        DeviceArray<double> array(where);
        array.resize(8);
        DeviceArray<float> later = DeviceArray<float>::in_memory_of(array);
        EXPECT_EQ(later.device(), where);
        EXPECT_EQ(later.size(), 0u);
        later.resize(8);
        EXPECT_EQ(static_cast<void*>(later.data()) == array.data(), where != nullptr);
        array.resize(800);  // grows, and moves
        later.resize(800);
        EXPECT_EQ(static_cast<void*>(later.data()) == array.data(), where != nullptr);
    }
}

TEST(Communicator, TakesArraysOfDevicesThroughTheHost) {
    for (const int size : {1, 2, 4}) {
        on_ranks(size, [&](Communicator& ranks) {
            expect_exchanged(ranks, nullptr);
            const Traffic of_host = ranks.traffic();
            EXPECT_EQ(of_host.device_exchanges, 0);
            // A rank may compute on the host while the others have devices.
            FakeDevice device;
            DeviceStream* const where = ranks.rank() == 1 ? nullptr : &device;
            for (int k = 0; k < 2; ++k) expect_exchanged(ranks, where);
            const Traffic both = ranks.traffic() - of_host;
            EXPECT_EQ(both.sent, 2 * of_host.sent);
            EXPECT_EQ(both.received, 2 * of_host.received);
            EXPECT_EQ(both.messages, 2 * of_host.messages);
            EXPECT_EQ(both.device_exchanges, where ? 2 : 0);
            EXPECT_EQ(device.copies > 0, where != nullptr && size > 1);
        });
    }
}

TEST(DeviceArray, LiesWhereItIsTold) {
    FakeDevice device;
    DeviceArray<float> array(&device);
    auto same = DeviceArray<std::uint32_t>::in_memory_of(array);
    const float* const own = array.resize(4);
    std::vector<float> place(8);
    for (const int at : {0, 4}) {
        array.lie_at(reinterpret_cast<std::byte*>(place.data() + at));
        EXPECT_EQ(array.resize(4), place.data() + at);
    }
    EXPECT_EQ(same.device(), &device);
    EXPECT_EQ(static_cast<void*>(same.resize(4)), place.data() + 4);
    array.lie_at(nullptr);
    EXPECT_EQ(array.resize(4), own) << "it has memory of its own, too";
}

TEST(Communicator, MeasuresTheWayOfArraysOnDevices) {
    on_ranks(2, [](Communicator& ranks) {
        FakeDevice device;
        const LinkSpeed speed = measure_link(ranks, &device);
        EXPECT_GT(speed.bytes_per_second, 0);
        EXPECT_GT(speed.latency_seconds, 0);
        EXPECT_GT(speed.device_latency_seconds, 0);
        EXPECT_GT(ranks.traffic().device_exchanges, 0);
        EXPECT_EQ(measure_link(ranks, nullptr).device_latency_seconds, 0);
    });
}

}  // namespace
}  // namespace gs::test
