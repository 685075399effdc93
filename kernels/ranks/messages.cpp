// SPDX-License-Identifier: Apache-2.0
// Writes and reads messages field by field: visit() lists the fields once for both.
#include "kernels/ranks/messages.h"

namespace gs {
namespace {

/// Calls field(x) for every field that is sent.
template <class Request, class Field> void visit_step(Request& r, Field&& field) {
    field(r.camera), field(r.background);
    field(r.target.width), field(r.target.height), field(r.target.channels), field(r.target.id);
    field(r.iteration), field(r.lambda_dssim), field(r.opacity_reg), field(r.scale_reg), field(r.noise), field(r.seed);
    field(r.gather_gradient_stats), field(r.only_visible), field(r.rates), field(r.residual_rates),
        field(r.shared_rate);
    field(r.center), field(r.extent), field(r.far_rate), field(r.isp), field(r.isp_rate);
}

template <class State, class Field> void visit_ppisp(State& s, Field&& field) {
    field(s.num_frames), field(s.num_cameras), field(s.step), field(s.param), field(s.m), field(s.v);
    field(s.controller_step), field(s.controller), field(s.controller_m), field(s.controller_v);
}

template <class Model, class Field> void visit_model(Model& s, Field&& field) {
    field(s.count), field(s.appearance.model), field(s.appearance.max_degree), field(s.appearance.activation);
    field(s.active_degree), field(s.step);
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
