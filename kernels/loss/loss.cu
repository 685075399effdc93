// SPDX-License-Identifier: Apache-2.0
// The loss on the device in two kernels: one computes SSIM's derivative maps, the other the gradient. A block filters a
// 32x32 tile of one channel with its 5-pixel border, first the rows, eight outputs a thread, then the columns, four
// outputs a thread. So a value read once from shared memory serves several taps. It is compiled with fast divisions and
// square roots, and without denormals (kernels/CMakeLists.txt).
#include <climits>
#include <type_traits>

#include "kernels/loss/loss_cuda.h"
#include "kernels/loss/loss_device.h"

namespace gs {
namespace {

constexpr int kTile = 32, kHalo = kTile + 2 * kSsimRadius, kThreads = 256;
constexpr int kAcross = 8, kDown = kTile * kTile / kThreads;  ///< outputs of a thread in a row and in a column
constexpr int kTapCount = 2 * kSsimRadius + 1;

struct LossArgs {
    CudaLossInput in;
    float l1_weight = 0, ssim_weight = 0;  ///< weight of a value in the means
    SsimTaps<float> taps{};

    __device__ float tap(int k) const { return taps.g[k < kSsimRadius ? kSsimRadius - k : k - kSsimRadius]; }

    __device__ std::size_t plane() const { return std::size_t(in.target.width) * in.target.height; }
};

__device__ float component(unsigned char x) { return x * (1.0f / 255.0f); }
__device__ float component(float x) { return x; }

/// A thread's pixels: kCount pixels of one column, in every `step`-th row. Pixels outside the image count as 0. If the
/// image contains all of them (kInside), no bounds are checked.
template <int kCount, bool kInside> class Column {
  public:
    __device__ Column(const LossArgs& a, int x, int y, int step)
        : first_(unsigned(y) * a.in.target.width + x),
          stride_(unsigned(step) * a.in.target.width),
          height_(a.in.target.height),
          step_(step),
          y_(x >= 0 && x < a.in.target.width ? y : INT_MIN / 2) {}

    /// Returns the index in a plane, for which 32 bits suffice: no side has 2^16 pixels (CudaEngine::enqueue_splats).
    __device__ unsigned pixel(int u) const { return first_ + u * stride_; }
    __device__ bool has(int u) const { return kInside || unsigned(y_ + u * step_) < unsigned(height_); }
    /// Calls fn(u, pixel) for each pixel inside the image.
    template <class Fn> __device__ void for_each(Fn&& fn) const {
#pragma unroll
        for (int u = 0; u < kCount; ++u)
            if (has(u)) fn(u, pixel(u));
    }

  private:
    unsigned first_, stride_;
    int height_, step_, y_;
};

/// Storage format of a photograph: the type of a component, and whether there is a fourth one, alpha.
template <class Component, bool kAlpha> struct Stored {
    struct Texel {
        Component color, alpha;
    };

    /// Returns channel c of a pixel, and its alpha.
    __device__ static Texel load(const TargetImage& t, unsigned pixel, int c) {
        const std::size_t first = std::size_t(pixel) * (kAlpha ? 4 : 3);
        if constexpr (std::is_same_v<Component, float>) {
            return {t.f32[first + c], kAlpha ? t.f32[first + 3] : 1.0f};
        } else if constexpr (kAlpha) {
            const unsigned word = reinterpret_cast<const unsigned*>(t.u8)[pixel];
            return {Component(word >> 8 * c), Component(word >> 24)};
        } else {
            return {t.u8[first + c], 255};
        }
    }

    /// Weights and photograph at some pixels. All loads are issued before the first is waited for.
    template <int kCount> struct Targets {
        float weight[kCount], value[kCount];  ///< values of channel c

        template <bool kInside> __device__ Targets(const LossArgs& a, int c, const Column<kCount, kInside>& column) {
            const TargetImage& t = a.in.target;
            Texel texels[kCount] = {};
            column.for_each([&](int u, unsigned pixel) { texels[u] = load(t, pixel, c); });
#pragma unroll
            for (int u = 0; u < kCount; ++u) weight[u] = column.has(u) ? 1.0f : 0.0f;
            if (t.mask) column.for_each([&](int u, unsigned pixel) { weight[u] = component(t.mask[pixel]); });
            const float background = c == 0 ? a.in.background.x : c == 1 ? a.in.background.y : a.in.background.z;
#pragma unroll
            for (int u = 0; u < kCount; ++u) {
                value[u] = component(texels[u].color);
                if (kAlpha) {
                    const float x = component(texels[u].alpha);
                    value[u] = fminf(fmaxf(x * value[u] + (1.0f - x) * background, 0.0f), 1.0f);
                }
            }
        }
    };
};

/// Calls fn with the storage format of the target.
template <class Fn> void with_storage(const TargetImage& target, Fn&& fn) {
    if (target.u8)
        target.channels == 3 ? fn(Stored<unsigned char, false>{}) : fn(Stored<unsigned char, true>{});
    else
        target.channels == 3 ? fn(Stored<float, false>{}) : fn(Stored<float, true>{});
}

/// Rows per load step of a tile with its border, with one thread for each of their pixels: six divides its 42 rows, and
/// 252 of the 256 threads load.
constexpr int kRowStep = 6, kLoads = kHalo / kRowStep, kLoaders = kRowStep * kHalo;
static_assert(kHalo % kRowStep == 0 && kLoaders <= kThreads);

/// The tile of a block, in one channel.
struct Tile {
    int c = blockIdx.z, x0 = blockIdx.x * kTile, y0 = blockIdx.y * kTile;

    /// Calls fn with whether the image contains the tile and its border, as a type. Most tiles are inside.
    template <class Fn> __device__ void with_bounds(const LossArgs& a, Fn&& fn) const {
        const bool inside = x0 >= kSsimRadius && y0 >= kSsimRadius && x0 + kTile + kSsimRadius <= a.in.target.width &&
                            y0 + kTile + kSsimRadius <= a.in.target.height;
        inside ? fn(std::true_type{}) : fn(std::false_type{});
    }
    /// Calls fn(pixels, column, row) in the loading threads: with their pixels, and the position of the first pixel in
    /// the tile.
    template <class Fn> __device__ void for_loads(const LossArgs& a, Fn&& fn) const {
        if (threadIdx.x >= kLoaders) return;
        const int i = threadIdx.x % kHalo, j = threadIdx.x / kHalo;
        with_bounds(a, [&](auto inside) {
            fn(Column<kLoads, inside.value>(a, x0 + i - kSsimRadius, y0 + j - kSsimRadius, kRowStep), i, j);
        });
    }
    /// Calls fn(pixels) in each thread with its output pixels, one below another from column i and row j on.
    template <class Fn> __device__ void for_outputs(const LossArgs& a, int i, int j, Fn&& fn) const {
        with_bounds(a, [&](auto inside) { fn(Column<kDown, inside.value>(a, x0 + i, y0 + j, 1)); });
    }
};

/// Sets sums[o] to the filtered value at output o, from input(t) with t = 0 .. kOutputs + 9.
template <int kOutputs, class Input> __device__ void filter(const LossArgs& a, float (&sums)[kOutputs], Input input) {
#pragma unroll
    for (int o = 0; o < kOutputs; ++o) sums[o] = 0;
#pragma unroll
    for (int t = 0; t < kOutputs + kTapCount - 1; ++t) {
        const float x = input(t);
#pragma unroll
        for (int o = 0; o < kOutputs; ++o)
            if (t - o >= 0 && t - o < kTapCount) sums[o] = fmaf(a.tap(t - o), x, sums[o]);
    }
}

/// Adds up one value of each thread in the first warp, whose lanes get the sum and return true. The other warps return
/// false without waiting; they must have nothing left to do. A kernel may call this only once.
__device__ bool add_up_in_first_warp(float& value) {
    constexpr int kWarps = kThreads / 32;
    __shared__ float parts[kWarps];
    value = warp_sum(value);
    if (threadIdx.x % 32 == 0) parts[threadIdx.x / 32] = value;
    if (threadIdx.x >= 32) {
        asm volatile("bar.arrive 1, %0;" ::"n"(kThreads) : "memory");
        return false;
    }
    asm volatile("bar.sync 1, %0;" ::"n"(kThreads) : "memory");
    value = warp_sum(threadIdx.x < kWarps ? parts[threadIdx.x] : 0.0f);
    return true;
}

__device__ unsigned block_number() { return blockIdx.x + gridDim.x * (blockIdx.y + gridDim.y * blockIdx.z); }

template <class Storage>
__global__ void __launch_bounds__(kThreads, 4)
    ssim_maps(LossArgs a, float* __restrict__ maps, float2* __restrict__ partials, StepControl* control) {
    __shared__ float2 tile[kHalo][kHalo + 1];  // render, target; the odd stride puts rows into different banks
    __shared__ float rows[5][kHalo][kTile + 1];
    const Tile block;
    const std::size_t plane = a.plane();
    const float* image = a.in.image + block.c * plane;
    bool equal = true;
    block.for_loads(a, [&](const auto& pixels, int i, int j) {
        float render[kLoads] = {};
        pixels.for_each([&](int u, unsigned pixel) { render[u] = image[pixel]; });
        const typename Storage::template Targets<kLoads> targets(a, block.c, pixels);
#pragma unroll
        for (int u = 0; u < kLoads; ++u) {
            const float2 v = {targets.weight[u] * render[u], targets.weight[u] * targets.value[u]};
            tile[j + u * kRowStep][i] = v;
            equal = equal && v.x == v.y;
        }
    });
    float sum = 0;
    // Writes the maps at the thread's pixels from ssim(o), o = 0 .. kDown - 1, and adds SSIM to the sum.
    const auto write = [&](auto ssim) {
        const int i = threadIdx.x % kTile, j = threadIdx.x / kTile * kDown;
        float *const p_map = maps + block.c * plane, *const q_map = p_map + 3 * plane, *const r_map = q_map + 3 * plane;
        block.for_outputs(a, i, j, [&](const auto& pixels) {
            pixels.for_each([&](int o, unsigned pixel) {
                const SsimPixel<float> p = ssim(o);
                const float w = a.in.target.mask ? component(a.in.target.mask[pixel]) : 1.0f, u = a.ssim_weight * w;
                p_map[pixel] = u * p.p;
                q_map[pixel] = u * p.q;
                r_map[pixel] = u * p.r;
                sum += w * p.ssim;
            });
        });
    };
    // If both images are equal, e.g. behind an object on a plain background, p + 2 x q + y r is 0. All pixels that read
    // these maps lie in the tile or its border, and are equal, too: the maps may be 0 themselves.
    if (__syncthreads_and(equal)) {
        write([](int) { return SsimPixel<float>{1, 0, 0, 0}; });
    } else {
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
                    const float g = a.tap(t - o);
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
        float s[5][kDown];
        const int i = threadIdx.x % kTile, first = threadIdx.x / kTile * kDown;
#pragma unroll
        for (int m = 0; m < 5; ++m) filter<kDown>(a, s[m], [&](int t) { return rows[m][first + t][i]; });
        write([&](int o) { return ssim_pixel(s[0][o], s[1][o], s[2][o], s[3][o], s[4][o]); });
    }
    if (add_up_in_first_warp(sum) && threadIdx.x == 0) {
        partials[block_number()].y = sum;
        if (!gs_isfinite(sum)) control->loss_not_finite = 1;
    }
}

template <class Storage>
__global__ void __launch_bounds__(kThreads, 4)
    loss_gradient(LossArgs a, const float* __restrict__ maps, float* __restrict__ dL_dimage,
                  float2* __restrict__ partials, StepControl* control) {
    __shared__ float tile[3][kHalo][kHalo + 1];  // odd stride, as above
    __shared__ float rows[3][kHalo][kTile + 1];
    const Tile block;
    const std::size_t plane = a.plane();
    bool zero = true;
    block.for_loads(a, [&](const auto& pixels, int i, int j) {
        float v[3][kLoads] = {};
#pragma unroll
        for (int m = 0; m < 3; ++m) {
            const float* map = maps + (block.c + 3 * m) * plane;
            pixels.for_each([&](int u, unsigned pixel) { v[m][u] = map[pixel]; });
        }
#pragma unroll
        for (int m = 0; m < 3; ++m)
#pragma unroll
            for (int u = 0; u < kLoads; ++u) tile[m][j + u * kRowStep][i] = v[m][u], zero = zero && v[m][u] == 0;
    });
    const int column = threadIdx.x % kTile, first = threadIdx.x / kTile * kDown;
    float f[3][kDown] = {};
    if (!__syncthreads_and(zero)) {
        if (threadIdx.x < kHalo * (kTile / kAcross)) {
            const int j = threadIdx.x % kHalo, i = threadIdx.x / kHalo * kAcross;
#pragma unroll
            for (int m = 0; m < 3; ++m) {
                float s[kAcross];
                filter<kAcross>(a, s, [&](int t) { return tile[m][j][i + t]; });
#pragma unroll
                for (int o = 0; o < kAcross; ++o) rows[m][j][i + o] = s[o];
            }
        }
        __syncthreads();
#pragma unroll
        for (int m = 0; m < 3; ++m) filter<kDown>(a, f[m], [&](int t) { return rows[m][first + t][column]; });
    }
    const float* image = a.in.image + block.c * plane;
    float *const gradient = dL_dimage + block.c * plane, sum = 0;
    block.for_outputs(a, column, first, [&](const auto& pixels) {
        float render[kDown] = {};
        pixels.for_each([&](int o, unsigned pixel) { render[o] = image[pixel]; });
        const typename Storage::template Targets<kDown> targets(a, block.c, pixels);
        pixels.for_each([&](int o, unsigned pixel) {
            const float w = targets.weight[o], p = w * render[o], t = w * targets.value[o], d = p - t;
            const L1Pixel<float> l1 = l1_pixel(d);
            sum += l1.value;
            gradient[pixel] = w * (a.l1_weight * l1.slope + f[0][o] + 2.0f * p * f[1][o] + t * f[2][o]);
        });
    });
    if (add_up_in_first_warp(sum) && threadIdx.x == 0) {
        partials[block_number()].x = sum;
        if (!gs_isfinite(sum)) control->loss_not_finite = 1;
    }
}

/// Writes the gradient of half the squared error, and adds that error to *error unless `error` is null. One thread
/// computes one pixel of a row and channel. Without an image it writes the weights alone.
template <class Storage>
__global__ void __launch_bounds__(kThreads)
    half_squared_error_of_pixels(LossArgs a, float* __restrict__ out, double* error) {
    const int c = blockIdx.z;
    const Column<1, false> pixels(a, blockIdx.x * kThreads + threadIdx.x, blockIdx.y, 1);
    const typename Storage::template Targets<1> target(a, c, pixels);
    float squared = 0;
    pixels.for_each([&](int, unsigned pixel) {
        const std::size_t at = c * a.plane() + pixel;
        const float weight = target.weight[0], difference = a.in.image ? a.in.image[at] - target.value[0] : 1.0f;
        out[at] = weight * difference;
        squared = 0.5f * weight * difference * difference;
    });
    if (!error) return;
    if (add_up_in_first_warp(squared) && threadIdx.x == 0) atomicAdd(error, double(squared));
}

dim3 grid_of(int width, int height) { return {num_blocks(width, kTile), num_blocks(height, kTile), 3}; }

}  // namespace

void write_half_squared_error(const CudaLossInput& in, float* out, double* error, cudaStream_t stream) {
    const dim3 grid(num_blocks(in.target.width, kThreads), in.target.height, 3);
    with_storage(in.target, [&](auto storage) {
        half_squared_error_of_pixels<decltype(storage)><<<grid, kThreads, 0, stream>>>({.in = in}, out, error);
    });
    GS_CUDA_LAUNCHED("half_squared_error_of_pixels");
}

void write_mask_weights(const TargetImage& target, float* out, cudaStream_t stream) {
    write_half_squared_error({.target = target}, out, nullptr, stream);
}

void CudaLoss::take(Carver& c, int width, int height) {
    const dim3 grid = grid_of(width, height);
    maps_ = c.take<float>(9 * std::size_t(width) * height);
    partials_ = c.take<float2>(std::size_t(grid.x) * grid.y * grid.z);
}

void CudaLoss::compute(const CudaLossInput& in, float* dL_dimage, StepControl* control, cudaStream_t stream) {
    sums_ = {};
    if (!(in.weight_sum > 0)) {  // the mask hides all pixels
        GS_CUDA(
            cudaMemsetAsync(dL_dimage, 0, 3 * std::size_t(in.target.width) * in.target.height * sizeof(float), stream));
        return;
    }
    const double lambda = in.weights.lambda_dssim, norm = 1 / (3 * in.weight_sum);
    const LossArgs args{.in = in, .l1_weight = float((1 - lambda) * norm), .ssim_weight = float(-lambda * norm)};
    const dim3 grid = grid_of(in.target.width, in.target.height);
    sums_ = {partials_, grid.x * grid.y * grid.z};
    with_storage(in.target, [&](auto storage) {
        ssim_maps<decltype(storage)><<<grid, kThreads, 0, stream>>>(args, maps_, partials_, control);
        GS_CUDA_LAUNCHED("ssim_maps");
        loss_gradient<decltype(storage)><<<grid, kThreads, 0, stream>>>(args, maps_, dL_dimage, partials_, control);
        GS_CUDA_LAUNCHED("loss_gradient");
    });
}

}  // namespace gs
