// SPDX-License-Identifier: Apache-2.0
// The loss on the device in two kernels: one makes SSIM's derivative maps, the other the gradient. A block filters a
// 32x32 tile of one channel with its 5-pixel border, first the rows, eight outputs a thread, then the columns, four
// outputs a thread. So a value that is read once from shared memory serves several taps.
#include <climits>
#include <type_traits>

#include "kernels/loss/loss_cuda.h"
#include "kernels/loss/loss_device.h"

namespace gs {
namespace {

constexpr int kTile = 32, kHalo = kTile + 2 * kSsimRadius, kThreads = 256;
constexpr int kAcross = 8, kDown = kTile * kTile / kThreads;  ///< outputs of a thread in a row and in a column
constexpr int kTapCount = 2 * kSsimRadius + 1;

__constant__ float kTaps[kTapCount];

struct LossArgs {
    CudaLossInput in;
    float l1_step, ssim_step;

    __device__ std::size_t plane() const { return std::size_t(in.target.width) * in.target.height; }
};

__device__ float component(unsigned char x) { return x * (1.0f / 255.0f); }
__device__ float component(float x) { return x; }

/// A thread's pixels: kCount of one column, in every `step`-th row. Those outside of the image count as 0.
template <int kCount> class Column {
  public:
    __device__ Column(const LossArgs& a, int x, int y, int step)
        : first_(std::int64_t(y) * a.in.target.width + x),
          stride_(std::int64_t(step) * a.in.target.width),
          height_(a.in.target.height),
          step_(step),
          y_(x >= 0 && x < a.in.target.width ? y : INT_MIN / 2) {}

    __device__ std::int64_t pixel(int u) const { return first_ + u * stride_; }
    __device__ bool has(int u) const { return unsigned(y_ + u * step_) < unsigned(height_); }
    /// Calls fn(u, pixel) for each pixel that the image has.
    template <class Fn> __device__ void for_each(Fn&& fn) const {
#pragma unroll
        for (int u = 0; u < kCount; ++u)
            if (has(u)) fn(u, pixel(u));
    }

  private:
    std::int64_t first_, stride_;
    int height_, step_, y_;
};

/// How photographs are stored: the type of a component, and whether there is a fourth, alpha.
template <class Component, bool kAlpha> struct Stored {
    static constexpr int kChannels = kAlpha ? 4 : 3;

    /// Weights and photograph at some pixels, all of whose loads are on their way before the first is waited for.
    template <int kCount> struct Targets {
        float weight[kCount], value[kCount];  ///< of channel c

        __device__ Targets(const LossArgs& a, int c, const Column<kCount>& column) {
            const TargetImage& t = a.in.target;
            const Component* stored;
            if constexpr (std::is_same_v<Component, float>)
                stored = t.f32;
            else
                stored = t.u8;
            Component color[kCount] = {}, alpha[kCount] = {};
            column.for_each([&](int u, std::int64_t pixel) {
                color[u] = stored[pixel * kChannels + c];
                if (kAlpha) alpha[u] = stored[pixel * kChannels + 3];
            });
#pragma unroll
            for (int u = 0; u < kCount; ++u) weight[u] = column.has(u) ? 1.0f : 0.0f;
            if (t.mask) column.for_each([&](int u, std::int64_t pixel) { weight[u] = component(t.mask[pixel]); });
            const float background = c == 0 ? a.in.background.x : c == 1 ? a.in.background.y : a.in.background.z;
#pragma unroll
            for (int u = 0; u < kCount; ++u) {
                value[u] = component(color[u]);
                if (kAlpha) {
                    const float x = component(alpha[u]);
                    value[u] = fminf(fmaxf(x * value[u] + (1.0f - x) * background, 0.0f), 1.0f);
                }
            }
        }
    };
};

/// Calls fn with how the target is stored.
template <class Fn> void with_storage(const TargetImage& target, Fn&& fn) {
    if (target.u8)
        target.channels == 3 ? fn(Stored<unsigned char, false>{}) : fn(Stored<unsigned char, true>{});
    else
        target.channels == 3 ? fn(Stored<float, false>{}) : fn(Stored<float, true>{});
}

/// A tile with its border is loaded by columns. Some threads have none, but none has to divide by the width of a tile.
constexpr int kColumns = 64, kRowStep = kThreads / kColumns, kLoads = (kHalo + kRowStep - 1) / kRowStep;

/// What this thread loads of a block's tile.
struct TilePart {
    int i = threadIdx.x % kColumns, j = threadIdx.x / kColumns;  ///< its column, and its first row

    __device__ Column<kLoads> pixels(const LossArgs& a, int x0, int y0) const {
        return {a, i < kHalo ? x0 + i - kSsimRadius : -1, y0 + j - kSsimRadius, kRowStep};
    }
    /// Calls fn(u, row) for all of them.
    template <class Fn> __device__ void for_rows(Fn&& fn) const {
        if (i >= kHalo) return;
#pragma unroll
        for (int u = 0; u < kLoads; ++u)
            if (u < kLoads - 1 || j + u * kRowStep < kHalo) fn(u, j + u * kRowStep);
    }
};

/// Sets sums[o] to the filtered value at output o, from input(t) with t = 0 .. kOutputs + 9.
template <int kOutputs, class Input> __device__ void filter(float (&sums)[kOutputs], Input input) {
#pragma unroll
    for (int o = 0; o < kOutputs; ++o) sums[o] = 0;
#pragma unroll
    for (int t = 0; t < kOutputs + kTapCount - 1; ++t) {
        const float x = input(t);
#pragma unroll
        for (int o = 0; o < kOutputs; ++o)
            if (t - o >= 0 && t - o < kTapCount) sums[o] = fmaf(kTaps[t - o], x, sums[o]);
    }
}

/// Returns the sum over the block, valid in thread 0.
__device__ float block_sum(float value) {
    __shared__ float parts[kThreads / 32];
    value = warp_sum(value);
    __syncthreads();
    if (threadIdx.x % 32 == 0) parts[threadIdx.x / 32] = value;
    __syncthreads();
    float sum = 0;
    for (float p : parts) sum += p;
    return sum;
}

__device__ unsigned block_number() { return blockIdx.x + gridDim.x * (blockIdx.y + gridDim.y * blockIdx.z); }

template <class Storage>
__global__ void __launch_bounds__(kThreads, 4)
    ssim_maps(LossArgs a, float* __restrict__ maps, float2* __restrict__ partials) {
    __shared__ float2 tile[kHalo][kHalo + 1];  // render, target; the odd stride puts rows into different banks
    __shared__ float rows[5][kHalo][kTile + 1];
    const int c = blockIdx.z, x0 = blockIdx.x * kTile, y0 = blockIdx.y * kTile;
    const std::size_t plane = a.plane();
    {
        const TilePart part;
        const Column<kLoads> pixels = part.pixels(a, x0, y0);
        float render[kLoads] = {};
        pixels.for_each([&](int u, std::int64_t pixel) { render[u] = a.in.image[c * plane + pixel]; });
        const typename Storage::template Targets<kLoads> targets(a, c, pixels);
        part.for_rows([&](int u, int j) {
            tile[j][part.i] = make_float2(targets.weight[u] * render[u], targets.weight[u] * targets.value[u]);
        });
    }
    __syncthreads();
    if (threadIdx.x < kHalo * (kTile / kAcross)) {
        const int j = threadIdx.x % kHalo, i = threadIdx.x / kHalo * kAcross;
        float s[5][kAcross] = {};
#pragma unroll
        for (int t = 0; t < kAcross + kTapCount - 1; ++t) {
            const float2 v = tile[j][i + t];
            const float xx = v.x * v.x, yy = v.y * v.y, xy = v.x * v.y;
#pragma unroll
            for (int o = 0; o < kAcross; ++o) {
                if (t - o < 0 || t - o >= kTapCount) continue;
                const float g = kTaps[t - o];
                s[0][o] = fmaf(g, v.x, s[0][o]), s[1][o] = fmaf(g, v.y, s[1][o]);
                s[2][o] = fmaf(g, xx, s[2][o]), s[3][o] = fmaf(g, yy, s[3][o]), s[4][o] = fmaf(g, xy, s[4][o]);
            }
        }
#pragma unroll
        for (int m = 0; m < 5; ++m)
#pragma unroll
            for (int o = 0; o < kAcross; ++o) rows[m][j][i + o] = s[m][o];
    }
    __syncthreads();
    const int i = threadIdx.x % kTile, first = threadIdx.x / kTile * kDown;
    float s[5][kDown];
#pragma unroll
    for (int m = 0; m < 5; ++m) filter<kDown>(s[m], [&](int t) { return rows[m][first + t][i]; });
    float sum = 0;
    Column<kDown>(a, x0 + i, y0 + first, 1).for_each([&](int o, std::int64_t pixel) {
        const SsimPixel<float> p = ssim_pixel(s[0][o], s[1][o], s[2][o], s[3][o], s[4][o]);
        const std::size_t at = c * plane + pixel;
        const float w = a.in.target.mask ? component(a.in.target.mask[pixel]) : 1.0f, u = a.ssim_step * w;
        maps[at] = u * p.p;
        maps[at + 3 * plane] = u * p.q;
        maps[at + 6 * plane] = u * p.r;
        sum += w * p.ssim;
    });
    sum = block_sum(sum);
    if (threadIdx.x == 0) partials[block_number()].y = sum;
}

/// Adds up all partial sums in the block that ends last; each thread adds its share in order.
__device__ void finish_sums(const float2* partials, StepControl* control) {
    __shared__ bool last;
    __shared__ double parts[2][kThreads];
    const unsigned blocks = gridDim.x * gridDim.y * gridDim.z;
    if (threadIdx.x == 0) {
        __threadfence();
        last = atomicAdd(&control->loss_blocks, 1) == blocks - 1;
    }
    __syncthreads();
    if (!last) return;
    __threadfence();
    double l1 = 0, ssim = 0;
    for (unsigned k = threadIdx.x; k < blocks; k += kThreads) {
        const float2 p = __ldcg(partials + k);
        l1 += p.x, ssim += p.y;
    }
    parts[0][threadIdx.x] = l1, parts[1][threadIdx.x] = ssim;
    for (int half = kThreads / 2; half; half /= 2) {
        __syncthreads();
        if (int(threadIdx.x) < half)
            for (auto& p : parts) p[threadIdx.x] += p[threadIdx.x + half];
    }
    if (threadIdx.x == 0) control->l1 = parts[0][0], control->ssim = parts[1][0];
}

template <class Storage>
__global__ void __launch_bounds__(kThreads, 4)
    loss_gradient(LossArgs a, const float* __restrict__ maps, float* __restrict__ dL_dimage,
                  float2* __restrict__ partials, StepControl* control) {
    __shared__ float tile[3][kHalo][kHalo + 1];  // odd stride, as above
    __shared__ float rows[3][kHalo][kTile + 1];
    const int c = blockIdx.z, x0 = blockIdx.x * kTile, y0 = blockIdx.y * kTile;
    const std::size_t plane = a.plane();
    {
        const TilePart part;
        float v[3][kLoads] = {};
        part.pixels(a, x0, y0).for_each([&](int u, std::int64_t pixel) {
#pragma unroll
            for (int m = 0; m < 3; ++m) v[m][u] = maps[(c + 3 * m) * plane + pixel];
        });
        part.for_rows([&](int u, int j) {
#pragma unroll
            for (int m = 0; m < 3; ++m) tile[m][j][part.i] = v[m][u];
        });
    }
    __syncthreads();
    if (threadIdx.x < kHalo * (kTile / kAcross)) {
        const int j = threadIdx.x % kHalo, i = threadIdx.x / kHalo * kAcross;
#pragma unroll
        for (int m = 0; m < 3; ++m) {
            float s[kAcross];
            filter<kAcross>(s, [&](int t) { return tile[m][j][i + t]; });
#pragma unroll
            for (int o = 0; o < kAcross; ++o) rows[m][j][i + o] = s[o];
        }
    }
    __syncthreads();
    const int i = threadIdx.x % kTile, first = threadIdx.x / kTile * kDown;
    float f[3][kDown];
#pragma unroll
    for (int m = 0; m < 3; ++m) filter<kDown>(f[m], [&](int t) { return rows[m][first + t][i]; });
    const Column<kDown> pixels(a, x0 + i, y0 + first, 1);
    float render[kDown] = {}, sum = 0;
    pixels.for_each([&](int o, std::int64_t pixel) { render[o] = a.in.image[c * plane + pixel]; });
    const typename Storage::template Targets<kDown> targets(a, c, pixels);
    pixels.for_each([&](int o, std::int64_t pixel) {
        const float w = targets.weight[o], p = w * render[o], t = w * targets.value[o], d = p - t;
        const float sign = d > 0 ? 1.0f : (d < 0 ? -1.0f : 0.0f);
        sum += d * sign;
        dL_dimage[c * plane + pixel] = w * (a.l1_step * sign + f[0][o] + 2.0f * p * f[1][o] + t * f[2][o]);
    });
    sum = block_sum(sum);
    if (threadIdx.x == 0) partials[block_number()].x = sum;
    finish_sums(partials, control);
}

/// With a thread per pixel of a row and channel. Without an image it writes the weights alone. `error` may be null.
template <class Storage>
__global__ void __launch_bounds__(kThreads) error_of_pixels(LossArgs a, float* __restrict__ out, double* error) {
    const int c = blockIdx.z;
    const Column<1> pixels(a, blockIdx.x * kThreads + threadIdx.x, blockIdx.y, 1);
    const typename Storage::template Targets<1> target(a, c, pixels);
    float squared = 0;
    pixels.for_each([&](int, std::int64_t pixel) {
        const std::size_t at = c * a.plane() + pixel;
        const float weight = target.weight[0], difference = a.in.image ? a.in.image[at] - target.value[0] : 1.0f;
        out[at] = weight * difference;
        squared = 0.5f * weight * difference * difference;
    });
    if (!error) return;
    const float sum = block_sum(squared);
    if (threadIdx.x == 0) atomicAdd(error, double(sum));
}

dim3 grid_of(int width, int height) { return {num_blocks(width, kTile), num_blocks(height, kTile), 3}; }

}  // namespace

void write_error(const CudaLossInput& in, float* out, double* error, cudaStream_t stream) {
    const dim3 grid(num_blocks(in.target.width, kThreads), in.target.height, 3);
    with_storage(in.target, [&](auto storage) {
        error_of_pixels<decltype(storage)><<<grid, kThreads, 0, stream>>>({in, 0, 0}, out, error);
    });
    GS_CUDA_LAUNCHED("error_of_pixels");
}

void write_weights(const TargetImage& target, float* out, cudaStream_t stream) {
    write_error({nullptr, target, {0, 0, 0}, 0, 0}, out, nullptr, stream);
}

void CudaLoss::take(Carver& c, int width, int height) {
    const dim3 grid = grid_of(width, height);
    maps_ = c.take<float>(9 * std::size_t(width) * height);
    partials_ = c.take<float2>(std::size_t(grid.x) * grid.y * grid.z);
}

void CudaLoss::compute(const CudaLossInput& in, float* dL_dimage, StepControl* control, cudaStream_t stream) {
    if (!has_taps_) {
        const SsimTaps<float> taps;
        float all[kTapCount];
        for (int k = 0; k < kTapCount; ++k) all[k] = taps.g[std::abs(k - kSsimRadius)];
        GS_CUDA(cudaMemcpyToSymbolAsync(kTaps, all, sizeof all, 0, cudaMemcpyHostToDevice, stream));
        GS_CUDA(cudaStreamSynchronize(stream));  // `all` goes out of scope
        has_taps_ = true;
    }
    if (!(in.weight_sum > 0)) {  // the mask hides all pixels
        GS_CUDA(
            cudaMemsetAsync(dL_dimage, 0, 3 * std::size_t(in.target.width) * in.target.height * sizeof(float), stream));
        return;
    }
    const LossArgs args{in, float((1 - in.lambda_dssim) / (3 * in.weight_sum)),
                        float(-in.lambda_dssim / (3 * in.weight_sum))};
    const dim3 grid = grid_of(in.target.width, in.target.height);
    with_storage(in.target, [&](auto storage) {
        ssim_maps<decltype(storage)><<<grid, kThreads, 0, stream>>>(args, maps_, partials_);
        GS_CUDA_LAUNCHED("ssim_maps");
        loss_gradient<decltype(storage)><<<grid, kThreads, 0, stream>>>(args, maps_, dL_dimage, partials_, control);
        GS_CUDA_LAUNCHED("loss_gradient");
    });
}

}  // namespace gs
