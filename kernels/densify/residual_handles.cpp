// SPDX-License-Identifier: Apache-2.0
// Replaces residuals by handles, and handles by residuals.
#include "kernels/densify/residual_handles.h"

#include <algorithm>
#include <numeric>

#include "kernels/densify/densify.h"

namespace gs {
namespace {

/// Returns the rows referred to by the handles of the first `count` rows in `order`; a null handle gives zeros.
std::vector<float> rows_of(const std::vector<float>& handles, const std::vector<std::uint32_t>& order,
                           std::int64_t count, const std::vector<float>& data, int width) {
    std::vector<float> out(std::size_t(count) * width, 0.0f);
    for (std::int64_t i = 0; i < count; ++i)
        if (const std::int64_t row = row_of_handle(handles[order[i]]); row >= 0)
            std::copy_n(data.begin() + row * width, width, out.begin() + i * width);
    return out;
}

}  // namespace

ResidualHandles::ResidualHandles(Gaussians& state, bool always)
    : state_(state), active_(state.is_mixed() || (always && state[Group::kResidual].width > 0)) {
    if (!active_) return;
    GroupArrays<float>& group = state_[Group::kResidual];
    const std::int64_t count = state_.num_residuals();
    residuals_.width = 1;
    for (auto [handles, data] : {std::pair{&residuals_.param, &group.param}, std::pair{&residuals_.m, &group.m},
                                 std::pair{&residuals_.v, &group.v}}) {
        if (data->empty() && count > 0) continue;  // a model without moments
        handles->resize(std::size_t(state_.count), 0.0f);
        for (std::int64_t i = 0; i < count; ++i) (*handles)[i] = residual_handle(i);
    }
    std::swap(residuals_, group);
}

ResidualHandles::~ResidualHandles() {
    if (active_) std::swap(residuals_, state_[Group::kResidual]);
}

void ResidualHandles::keep(const std::vector<std::uint8_t>& marks, const std::vector<float>& bases) {
    if (!active_) return;
    std::vector<float>& handles = state_[Group::kResidual].param;
    for (std::int64_t i = 0; i < state_.count; ++i) {
        if (marks[i] || row_of_handle(handles[i]) < 0) continue;
        handles[i] = 0;
        if (!bases.empty()) std::copy_n(&bases[3 * i], 3, &state_[Group::kBase].param[3 * i]);
    }
}

void ResidualHandles::resolve() {
    if (!active_) return;
    GroupArrays<float>& handles = state_[Group::kResidual];
    std::vector<std::uint32_t> order(std::size_t(state_.count));
    std::iota(order.begin(), order.end(), 0u);
    const auto end = std::stable_partition(order.begin(), order.end(),
                                           [&](std::uint32_t i) { return row_of_handle(handles.param[i]) >= 0; });
    const std::int64_t count = end - order.begin();
    GroupArrays<float> out;  // before rows move, since this may run out of memory
    out.width = residuals_.width;
    out.param = rows_of(handles.param, order, count, residuals_.param, out.width);
    if (!handles.m.empty()) out.m = rows_of(handles.m, order, count, residuals_.m, out.width);
    if (!handles.v.empty()) out.v = rows_of(handles.v, order, count, residuals_.v, out.width);
    if (!std::is_sorted(order.begin(), order.end())) gather_rows(state_, order);
    active_ = false;
    std::swap(handles, out);
}

}  // namespace gs
