// SPDX-License-Identifier: Apache-2.0
// The loss on the device in two kernels: one makes SSIM's derivative maps, the other the gradient. A block filters a
// 32x32 tile of one channel with its 5-pixel border, first the rows, eight outputs a thread, then the columns, four
// outputs a thread. So a value that is read once from shared memory serves several taps.
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

    __device__ bool inside(int x, int y) const {
        return x >= 0 && y >= 0 && x < in.target.width && y < in.target.height;
    }
    __device__ std::size_t pixel(int x, int y) const { return std::size_t(y) * in.target.width + x; }
    __device__ std::int64_t pixel_or_none(int x, int y) const { return inside(x, y) ? std::int64_t(pixel(x, y)) : -1; }
    __device__ std::size_t plane() const { return std::size_t(in.target.width) * in.target.height; }
};

__device__ float component(unsigned char x) { return x * (1.0f / 255.0f); }
__device__ float component(float x) { return x; }

/// Weights and photograph at some pixels, all of whose loads are on their way before the first is waited for. Pixels
/// with a negative number are 0.
template <int kCount> struct Targets {
    float weight[kCount], value[kCount];  ///< of channel c

    __device__ Targets(const LossArgs& a, int c, const std::int64_t (&pixels)[kCount]) {
        if (a.in.target.u8)
            load(a, a.in.target.u8, c, pixels);
        else
            load(a, a.in.target.f32, c, pixels);
    }

  private:
    template <class Component>
    __device__ void load(const LossArgs& a, const Component* stored, int c, const std::int64_t (&pixels)[kCount]) {
        const TargetImage& t = a.in.target;
        const bool with_alpha = t.channels != 3;
        Component color[kCount] = {}, alpha[kCount] = {};
        unsigned char mask[kCount] = {};
#pragma unroll
        for (int u = 0; u < kCount; ++u) {
            if (pixels[u] < 0) continue;
            color[u] = stored[pixels[u] * t.channels + c];
            if (with_alpha) alpha[u] = stored[pixels[u] * t.channels + 3];
            if (t.mask) mask[u] = t.mask[pixels[u]];
        }
        const float background = c == 0 ? a.in.background.x : c == 1 ? a.in.background.y : a.in.background.z;
#pragma unroll
        for (int u = 0; u < kCount; ++u) {
            weight[u] = t.mask ? component(mask[u]) : 1.0f;
            value[u] = component(color[u]);
            if (with_alpha) {
                const float x = component(alpha[u]);
                value[u] = fminf(fmaxf(x * value[u] + (1.0f - x) * background, 0.0f), 1.0f);
            }
            if (pixels[u] < 0) weight[u] = value[u] = 0;
        }
    }
};

/// The number of pixels of a tile with its border that a thread loads.
constexpr int kLoads = (kHalo * kHalo + kThreads - 1) / kThreads;

/// Calls fn(u, i, j) for the places of the tile that this thread loads: its u-th, in column i and row j.
template <class Fn> __device__ void for_loads(Fn&& fn) {
#pragma unroll
    for (int u = 0; u < kLoads; ++u)
        if (const int k = threadIdx.x + u * kThreads; k < kHalo * kHalo) fn(u, k % kHalo, k / kHalo);
}

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

__global__ void __launch_bounds__(kThreads, 4)
    ssim_maps(LossArgs a, float* __restrict__ maps, float2* __restrict__ partials) {
    __shared__ float2 tile[kHalo][kHalo + 1];  // render, target; the odd stride puts rows into different banks
    __shared__ float rows[5][kHalo][kTile + 1];
    const int c = blockIdx.z, x0 = blockIdx.x * kTile, y0 = blockIdx.y * kTile;
    const std::size_t plane = a.plane();
    {
        std::int64_t pixels[kLoads];
        float render[kLoads];
        for (std::int64_t& pixel : pixels) pixel = -1;  // a thread's last may lie behind the tile
        for_loads([&](int u, int i, int j) {
            pixels[u] = a.pixel_or_none(x0 + i - kSsimRadius, y0 + j - kSsimRadius);
            render[u] = pixels[u] >= 0 ? a.in.image[c * plane + pixels[u]] : 0.0f;
        });
        const Targets<kLoads> targets(a, c, pixels);
        for_loads([&](int u, int i, int j) {
            tile[j][i] = make_float2(targets.weight[u] * render[u], targets.weight[u] * targets.value[u]);
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
#pragma unroll
    for (int o = 0; o < kDown; ++o) {
        const int x = x0 + i, y = y0 + first + o;
        if (!a.inside(x, y)) continue;
        const SsimPixel<float> p = ssim_pixel(s[0][o], s[1][o], s[2][o], s[3][o], s[4][o]);
        const std::size_t pixel = a.pixel(x, y), at = c * plane + pixel;
        const float w = a.in.target.mask ? component(a.in.target.mask[pixel]) : 1.0f, u = a.ssim_step * w;
        maps[at] = u * p.p;
        maps[at + 3 * plane] = u * p.q;
        maps[at + 6 * plane] = u * p.r;
        sum += w * p.ssim;
    }
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

__global__ void __launch_bounds__(kThreads, 4)
    loss_gradient(LossArgs a, const float* __restrict__ maps, float* __restrict__ dL_dimage,
                  float2* __restrict__ partials, StepControl* control) {
    __shared__ float tile[3][kHalo][kHalo + 1];  // odd stride, as above
    __shared__ float rows[3][kHalo][kTile + 1];
    const int c = blockIdx.z, x0 = blockIdx.x * kTile, y0 = blockIdx.y * kTile;
    const std::size_t plane = a.plane();
    {
        float v[3][kLoads];
        for_loads([&](int u, int i, int j) {
            const std::int64_t pixel = a.pixel_or_none(x0 + i - kSsimRadius, y0 + j - kSsimRadius);
#pragma unroll
            for (int m = 0; m < 3; ++m) v[m][u] = pixel >= 0 ? maps[(c + 3 * m) * plane + pixel] : 0.0f;
        });
        for_loads([&](int u, int i, int j) {
#pragma unroll
            for (int m = 0; m < 3; ++m) tile[m][j][i] = v[m][u];
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
    std::int64_t pixels[kDown];
    float render[kDown], sum = 0;
#pragma unroll
    for (int o = 0; o < kDown; ++o) {
        pixels[o] = a.pixel_or_none(x0 + i, y0 + first + o);
        render[o] = pixels[o] >= 0 ? a.in.image[c * plane + pixels[o]] : 0.0f;
    }
    const Targets<kDown> targets(a, c, pixels);
#pragma unroll
    for (int o = 0; o < kDown; ++o) {
        if (pixels[o] < 0) continue;
        const float w = targets.weight[o], p = w * render[o], t = w * targets.value[o], d = p - t;
        const float sign = d > 0 ? 1.0f : (d < 0 ? -1.0f : 0.0f);
        sum += d * sign;
        dL_dimage[c * plane + pixels[o]] = w * (a.l1_step * sign + f[0][o] + 2.0f * p * f[1][o] + t * f[2][o]);
    }
    sum = block_sum(sum);
    if (threadIdx.x == 0) partials[block_number()].x = sum;
    finish_sums(partials, control);
}

/// With a thread per pixel of a row and channel. Without an image it writes the weights alone. `error` may be null.
__global__ void __launch_bounds__(kThreads) error_of_pixels(LossArgs a, float* __restrict__ out, double* error) {
    const int c = blockIdx.z;
    const std::int64_t pixels[] = {a.pixel_or_none(blockIdx.x * kThreads + threadIdx.x, blockIdx.y)};
    float squared = 0;
    if (pixels[0] >= 0) {
        const Targets<1> target(a, c, pixels);
        const std::size_t at = c * a.plane() + pixels[0];
        const float weight = target.weight[0], difference = a.in.image ? a.in.image[at] - target.value[0] : 1.0f;
        out[at] = weight * difference;
        squared = 0.5f * weight * difference * difference;
    }
    if (!error) return;
    const float sum = block_sum(squared);
    if (threadIdx.x == 0) atomicAdd(error, double(sum));
}

dim3 grid_of(int width, int height) { return {num_blocks(width, kTile), num_blocks(height, kTile), 3}; }

}  // namespace

void write_error(const CudaLossInput& in, float* out, double* error, cudaStream_t stream) {
    const dim3 grid(num_blocks(in.target.width, kThreads), in.target.height, 3);
    error_of_pixels<<<grid, kThreads, 0, stream>>>({in, 0, 0}, out, error);
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
    ssim_maps<<<grid, kThreads, 0, stream>>>(args, maps_, partials_);
    GS_CUDA_LAUNCHED("ssim_maps");
    loss_gradient<<<grid, kThreads, 0, stream>>>(args, maps_, dL_dimage, partials_, control);
    GS_CUDA_LAUNCHED("loss_gradient");
}

}  // namespace gs
