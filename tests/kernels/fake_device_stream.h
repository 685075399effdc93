// SPDX-License-Identifier: Apache-2.0
// A device without a GPU, and exchanges of arrays that lie on it.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <vector>

#include "kernels/base/device_array.h"
#include "kernels/ranks/communicator.h"

namespace gs::test {

/// A device whose memory is the host's. Counts what is copied between that and arrays.
class FakeDevice final : public DeviceStream {
  public:
    std::atomic<int> copies = 0;

    std::unique_ptr<DeviceBlock> make_block() override { return std::make_unique<Block>(); }
    void copy(void* to, const void* from, std::size_t bytes) override {
        ++copies;
        std::memcpy(to, from, bytes);
    }
    void wait() override {}
    void mark() override {}
    void* begin_transfer() override { return nullptr; }
    void join_transfers() override {}

  private:
    struct Block final : DeviceBlock {
        std::vector<std::byte> bytes;
        std::byte* reserve(std::size_t size) override {
            if (size > bytes.size()) bytes = std::vector<std::byte>(size);
            return bytes.data();
        }
    };
};

/// Returns the number of values that one rank sends to another: none to some, and different ones to the rest.
inline std::size_t num_sent(int from, int to) {
    return (from + 2 * to) % 3 == 0 ? 0 : std::size_t(100 * from + 10 * to + 1);
}
inline float value_sent(int from, int to, std::size_t k) { return float(1000 * from + 100 * to) + float(k); }

/// Exchanges parts of two arrays on a device, or of the host where it is null, and checks what comes. Parts begin at
/// multiples of 16 bytes.
inline void expect_exchanged(Communicator& ranks, DeviceStream* device) {
    const std::size_t size = std::size_t(ranks.size());
    std::vector<float> values, expected, copy;
    std::vector<std::size_t> sent_from, received_from;
    for (int r = 0; r < ranks.size(); ++r) {
        sent_from.push_back(values.size()), received_from.push_back(expected.size());
        for (std::size_t k = 0; k < num_sent(ranks.rank(), r); ++k) values.push_back(value_sent(ranks.rank(), r, k));
        for (std::size_t k = 0; k < num_sent(r, ranks.rank()); ++k) expected.push_back(value_sent(r, ranks.rank(), k));
        for (auto* part : {&values, &expected}) part->resize((part->size() + 3) / 4 * 4, -1.0f);
    }
    DeviceArray<float> sent(device), received(device);
    sent.assign(values);
    received.assign(std::vector<float>(expected.size(), -1.0f));
    std::vector<ConstBytes> out(size);
    std::vector<Bytes> in(size);
    for (std::size_t r = 0; r < size; ++r) {
        out[r] = sent.bytes(sent_from[r], sent_from[r] + num_sent(ranks.rank(), int(r)));
        in[r] = received.bytes(received_from[r], received_from[r] + num_sent(int(r), ranks.rank()));
    }
    ranks.exchange(out, in, device);
    const auto found = received.on_host(copy);
    EXPECT_EQ(std::vector<float>(found.begin(), found.end()), expected) << "on rank " << ranks.rank();
}

}  // namespace gs::test
