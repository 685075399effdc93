// SPDX-License-Identifier: Apache-2.0
// The model on the device: the rows of all groups with their moments.
#pragma once

#include <vector>

#include "kernels/cuda/device_memory.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

struct CudaModel {
    std::int64_t count = 0;
    std::int64_t without_residual = 0;  ///< number of Gaussians without a residual: the last ones
    int width[kNumGroups] = {};
    DeviceBuffer<float> param[kNumGroups], m[kNumGroups], v[kNumGroups];  ///< (count, width)
    bool packed_moments = false;  ///< residuals: m holds packed words of both moments, v is empty (packed_moments.h)
    bool has_statistic = false;   ///< whether gradient_sum and gradient_count hold `count` values
    DeviceBuffer<float> gradient_sum, gradient_count;
    bool has_last_step = false;  ///< whether last_step holds `count` values
    DeviceBuffer<float> last_step;
    /// Handles that replace the residuals and their moments while rows of a mixed model move
    /// (kernels/densify/rows_cuda.h).
    DeviceBuffer<float> handles[3];
    bool rows_moved = false;                               ///< whether rows moved since the handles took their place
    bool broken = false;                                   ///< whether an error prevented the return of the residuals
    DeviceBuffer<float> shared_param, shared_m, shared_v;  ///< weights shared by all Gaussians
    DeviceBuffer<unsigned> shared_prepared;                ///< these weights in the format for kernels

    std::int64_t num_residuals() const { return width[int(Group::kResidual)] > 0 ? count - without_residual : 0; }
    std::int64_t rows(int group) const { return group == int(Group::kResidual) ? num_residuals() : count; }
    std::size_t floats(int group) const { return std::size_t(rows(group)) * width[group]; }
    /// Returns the arrays that hold a group's moments. Zeros in the arrays are moments of 0.
    std::vector<DeviceBuffer<float>*> moments(int group) {
        if (packed_moments && group == int(Group::kResidual)) return {&m[group]};
        return {&m[group], &v[group]};
    }
    /// Returns the number of rows for which the opacities have room.
    std::size_t row_capacity() const { return param[int(Group::kOpacity)].capacity(); }
    /// Returns the variances of the 3-D filter, (count), or null without it.
    float* smoothing() const {
        const int g = int(Group::kSmoothing);
        return width[g] > 0 ? param[g].get() : nullptr;
    }
    ModelArrays arrays() const {
        ModelArrays a{};
        for (int g = 0; g < kNumGroups; ++g)
            a.param[g] = param[g].get(), a.m[g] = m[g].get(), a.v[g] = v[g].get(), a.width[g] = width[g];
        a.shared_param = shared_param.get(), a.shared_m = shared_m.get(), a.shared_v = shared_v.get();
        return a;
    }
    /// Makes room for n rows in every group and keeps the existing rows.
    void reserve_rows(std::int64_t n) {
        for (int g = 0; g < kNumGroups; ++g) {
            param[g].grow(std::size_t(n) * width[g], floats(g));
            for (auto* moment : moments(g)) moment->grow(std::size_t(n) * width[g], floats(g));
        }
        if (has_last_step) last_step.grow(std::size_t(n), std::size_t(count));
    }
    /// Frees the memory of removed rows, if it is more than an eighth.
    void shrink_rows() {
        const auto shrink = [](DeviceBuffer<float>& buffer, std::size_t n) {
            if (buffer.capacity() > n + n / 8) buffer.shrink(n);
        };
        for (int g = 0; g < kNumGroups; ++g) {
            shrink(param[g], floats(g));
            for (auto* moment : moments(g)) shrink(*moment, floats(g));
        }
        if (has_last_step) shrink(last_step, std::size_t(count));
    }
    std::int64_t bytes() const {
        std::int64_t sum = gradient_sum.bytes() + gradient_count.bytes() + last_step.bytes();
        for (int g = 0; g < kNumGroups; ++g) sum += param[g].bytes() + m[g].bytes() + v[g].bytes();
        for (const auto& buffer : handles) sum += buffer.bytes();
        for (const auto* buffer : {&shared_param, &shared_m, &shared_v}) sum += buffer->bytes();
        return sum + shared_prepared.bytes();
    }
};

}  // namespace gs
