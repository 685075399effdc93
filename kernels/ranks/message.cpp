// SPDX-License-Identifier: Apache-2.0
// Sends a message in a packet of fixed size, which is enough for the command of a step, and what is longer in another.
#include "kernels/ranks/message.h"

#include <algorithm>

namespace gs {
namespace {

struct FirstPacket {
    static constexpr std::size_t kBytes = kFirstPacketBytes - sizeof(std::uint64_t);
    std::uint64_t size = 0;  ///< of the whole message
    std::byte bytes[kBytes] = {};
};
static_assert(sizeof(FirstPacket) == kFirstPacketBytes);

template <class IsMeant> void send(Communicator& ranks, const MessageWriter& message, IsMeant&& is_meant) {
    const ConstBytes all(message.bytes());
    std::vector<FirstPacket> first(1);
    first[0].size = all.size();
    const std::size_t in_first = std::min(all.size(), FirstPacket::kBytes);
    std::copy_n(all.begin(), in_first, first[0].bytes);
    for (const ConstBytes part : {bytes_of(first), all.subspan(in_first)}) {
        if (part.empty()) continue;
        std::vector<ConstBytes> out(std::size_t(ranks.size()));
        for (int r = 0; r < ranks.size(); ++r)
            if (is_meant(r)) out[std::size_t(r)] = part;
        ranks.exchange(out, std::vector<Bytes>(out.size()));
    }
}

}  // namespace

void send_to_others(Communicator& ranks, const MessageWriter& message) {
    send(ranks, message, [&](int rank) { return rank != ranks.rank(); });
}

void send_to(Communicator& ranks, int to, const MessageWriter& message) {
    send(ranks, message, [&](int rank) { return rank == to; });
}

MessageReader receive_from_rank_0(Communicator& ranks) {
    std::vector<Bytes> in(std::size_t(ranks.size()));
    const std::vector<ConstBytes> out(in.size());
    std::vector<FirstPacket> first(1);
    in[0] = room_of(first);
    ranks.exchange(out, in);
    std::vector<std::byte> bytes(first[0].size);
    const std::size_t in_first = std::min(bytes.size(), FirstPacket::kBytes);
    std::copy_n(first[0].bytes, in_first, bytes.begin());
    if (in_first < bytes.size()) {
        in[0] = Bytes(bytes).subspan(in_first);
        ranks.exchange(out, in);
    }
    return MessageReader(std::move(bytes));
}

}  // namespace gs
