// SPDX-License-Identifier: Apache-2.0
// Sends a message in a packet of fixed size, which fits the command of a step, and the rest of a longer message in
// another packet. Structures are written and read field by field: visit() lists the fields once for both.
#include "kernels/ranks/message.h"

#include <algorithm>

namespace gs {
namespace {

struct FirstPacket {
    static constexpr std::size_t kBytes = kFirstPacketBytes - sizeof(std::uint64_t);
    std::uint64_t size = 0;  ///< size of the whole message
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

/// Calls field(x) for every field that is sent: all of StepRequest except memory on rank 0.
template <class Request, class Field> void visit_step(Request& r, Field&& field) {
    field(r.camera), field(r.background);
    field(r.target.width), field(r.target.height), field(r.target.channels), field(r.target.id);
    field(r.isp), field(r.iteration), field(r.seed), field(r.loss), field(r.gather_gradient_stats);
    field(r.only_visible), field(r.gather_camera_gradient), field(r.rates.groups), field(r.rates.residuals),
        field(r.rates.shared), field(r.rates.isp);
    field(r.rates.noise), field(r.rates.center), field(r.rates.extent), field(r.rates.far);
}

template <class State, class Field> void visit_ppisp(State& s, Field&& field) {
    field(s.num_frames), field(s.num_cameras), field(s.step), field(s.param), field(s.m), field(s.v);
    field(s.controller_step), field(s.controller), field(s.controller_m), field(s.controller_v);
}

template <class Model, class Field> void visit_model(Model& s, Field&& field) {
    field(s.count), field(s.appearance.model), field(s.appearance.max_degree), field(s.appearance.activation);
    field(s.active_degree), field(s.antialiased), field(s.step);
    const auto visit_group = [&](auto& group) {
        field(group.width), field(group.param), field(group.m), field(group.v);
    };
    for (auto& group : s.groups) visit_group(group);
    visit_group(s.shared);
    field(s.gradient_sum), field(s.gradient_count), field(s.last_step);
    visit_ppisp(s.ppisp, field);
}

auto writes(MessageWriter& to) {
    return [&to](const auto& value) { to.put(value); };
}
auto reads(MessageReader& from) {
    return [&from](auto& value) { from.get(value); };
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

void put(MessageWriter& to, const StepRequest& request) { visit_step(request, writes(to)); }
void get(MessageReader& from, StepRequest& request) { visit_step(request, reads(from)); }

void put(MessageWriter& to, const std::vector<StepRequest>& requests) {
    to.put(std::uint64_t(requests.size()));
    for (const StepRequest& request : requests) put(to, request);
}
void get(MessageReader& from, std::vector<StepRequest>& requests) {
    requests.resize(from.get<std::uint64_t>());
    for (StepRequest& request : requests) get(from, request);
}

void put(MessageWriter& to, const Gaussians& model) {
    std::size_t most = 0;
    visit_model(model, [&](const auto& value) {
        most += sizeof value;
        if constexpr (requires { value.capacity(); }) most += value.size() * sizeof value[0];
    });
    to.reserve(most);
    visit_model(model, writes(to));
}
void get(MessageReader& from, Gaussians& model) { visit_model(model, reads(from)); }

void put(MessageWriter& to, const PpispState& state) { visit_ppisp(state, writes(to)); }
void get(MessageReader& from, PpispState& state) { visit_ppisp(state, reads(from)); }

}  // namespace gs
