// SPDX-License-Identifier: Apache-2.0
// Sends a message after its length.
#include "kernels/ranks/message.h"

namespace gs {
namespace {

template <class IsMeant> void send(Communicator& ranks, const MessageWriter& message, IsMeant&& is_meant) {
    const std::uint64_t size = message.bytes().size();
    for (const ConstBytes part : {std::as_bytes(std::span(&size, 1)), ConstBytes(message.bytes())}) {
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
    std::vector<std::uint64_t> size(1);
    in[0] = room_of(size);
    ranks.exchange(out, in);
    std::vector<std::byte> bytes(size[0]);
    in[0] = bytes;
    ranks.exchange(out, in);
    return MessageReader(std::move(bytes));
}

}  // namespace gs
