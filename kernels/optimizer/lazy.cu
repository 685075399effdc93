// SPDX-License-Identifier: Apache-2.0
// Takes the missed steps of whole rows at once.
#include "kernels/optimizer/lazy_cuda.h"

namespace gs {
namespace {

constexpr int kBlock = 256;

__global__ void fill(std::int64_t n, std::uint32_t value, std::uint32_t* out) {
    const std::int64_t i = std::int64_t(blockIdx.x) * kBlock + threadIdx.x;
    if (i < n) out[i] = value;
}

/// Takes the missed steps of all rows, with one warp per row.
__global__ void catch_up_all(std::int64_t n, int width, LazyArgs lazy, float* __restrict__ p) {
    const std::int64_t row = (std::int64_t(blockIdx.x) * kBlock + threadIdx.x) / 32;
    const int lane = threadIdx.x & 31;
    if (row >= n) return;
    const int lag = lazy.lag(row);
    if (lag <= 0) return;
    const float sum = lazy.table.sums[lag], decay_m = first_moment_decay(lag), decay_v = second_moment_decay(lag);
    const MomentRows moments = lazy.moments.at(row * width);
    const std::uint32_t seed = mix_bits(std::uint32_t(row) ^ mix_bits(lazy.step));
    p += row * width;
    for (int k = lane; k < width; k += 32) {
        float m, v;
        moments.load(k, m, v);
        moments.unpack(m, v);
        p[k] = catch_up_parameter(p[k], m, v, sum, lazy.table.epsilon);
        moments.store(k, m * decay_m, v * decay_v, seed);
    }
    __syncwarp();
    if (lane == 0) lazy.last_step[row] = lazy.step - 1;
}

}  // namespace

void CudaLazyResiduals::reset(std::int64_t step) {
    step_ = caught_up_ = step;
    filled_ = false;
}

LazyArgs CudaLazyResiduals::begin_step(std::int64_t step, bool lazy, double rate) {
    if (const std::int64_t n = model_.num_residuals(); lazy && !filled_ && n > 0) {
        fill<<<num_blocks(n, kBlock), kBlock, 0, stream_>>>(n, std::uint32_t(step - 1), last_step_.reserve(n));
        GS_CUDA_LAUNCHED("fill");
        filled_ = true;
    }
    LazyArgs args{};
    args.step = std::uint32_t(step);
    args.last_step = last_step_.get();
    args.moments = {model_.m[int(Group::kResidual)].get(), model_.v[int(Group::kResidual)].get()};
    args.table = schedule_.table();
    schedule_.advance(rate, step);
    step_ = step;
    if (!lazy) args.last_step = nullptr, caught_up_ = step;
    return args;
}

void CudaLazyResiduals::catch_up() {
    const int width = model_.width[int(Group::kResidual)];
    const std::int64_t n = model_.num_residuals();
    const bool behind = step_ != caught_up_ && n > 0 && width > 0;
    caught_up_ = step_;
    if (!behind) return;
    constexpr int k = int(Group::kResidual);
    const LazyArgs args{
        last_step_.get(), std::uint32_t(step_ + 1), {model_.m[k].get(), model_.v[k].get()}, schedule_.table()};
    catch_up_all<<<num_blocks(32 * n, kBlock), kBlock, 0, stream_>>>(n, width, args, model_.param[k].get());
    GS_CUDA_LAUNCHED("catch_up_all");
}

}  // namespace gs
