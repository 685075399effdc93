// SPDX-License-Identifier: Apache-2.0
// Arrays of ranks that lie on a device, and their way to others through the host.
#include <gtest/gtest.h>

#include <numeric>

#include "kernels/ranks/communicator.h"
#include "tests/kernels/fake_device_stream.h"
#include "tests/kernels/rank_threads.h"

namespace gs::test {
namespace {

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
