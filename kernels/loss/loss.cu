// SPDX-License-Identifier: Apache-2.0
// Two kernels: SSIM's derivative maps, then the gradient. Each block filters a 16x16 tile with its 5-pixel border
// through shared memory, rows first.
#include "kernels/loss/loss_cuda.h"
#include "kernels/loss/loss_device.h"

namespace gs {
namespace {

constexpr int kTile = 16, kHalo = kTile + 2 * kSsimRadius;

__constant__ float kTaps[kSsimRadius + 1];

struct LossArgs {
    CudaLossInput in;
    float l1_step, ssim_step;
};

__device__ float weight_at(const LossArgs& a, int x, int y) {
    return a.in.target.mask ? a.in.target.mask[std::size_t(y) * a.in.target.width + x] * (1.0f / 255.0f) : 1.0f;
}

__device__ float target_at(const LossArgs& a, int c, int x, int y) {
    const TargetImage& t = a.in.target;
    const std::size_t i = (std::size_t(y) * t.width + x) * t.channels;
    const float value = t.u8 ? t.u8[i + c] / 255.0f : t.f32[i + c];
    if (t.channels == 3) return value;
    const float alpha = t.u8 ? t.u8[i + 3] / 255.0f : t.f32[i + 3];
    const float bg = c == 0 ? a.in.background.x : c == 1 ? a.in.background.y : a.in.background.z;
    return fminf(fmaxf(alpha * value + (1.0f - alpha) * bg, 0.0f), 1.0f);
}

__device__ float filter_at(const float* row, int stride) {
    float s = kTaps[0] * row[0];
#pragma unroll
    for (int k = 1; k <= kSsimRadius; ++k) s += kTaps[k] * (row[k * stride] + row[-k * stride]);
    return s;
}

/// Sum over the block, added once to a double.
__device__ void add_block_sum(float value, double* total) {
    for (int k = 16; k; k /= 2) value += __shfl_xor_sync(~0u, value, k);
    __shared__ float parts[kTile * kTile / 32];
    const int thread = threadIdx.y * kTile + threadIdx.x;
    if (thread % 32 == 0) parts[thread / 32] = value;
    __syncthreads();
    if (thread == 0) {
        double sum = 0;
        for (float p : parts) sum += p;
        atomicAdd(total, sum);
    }
}

__global__ void __launch_bounds__(kTile* kTile) ssim_maps(LossArgs a, float* __restrict__ maps, double* __restrict__ ssim_total) {
    __shared__ float sx[kHalo][kHalo + 1], sy[kHalo][kHalo + 1];
    __shared__ float rows[5][kHalo][kTile + 1];
    const int width = a.in.target.width, height = a.in.target.height, c = blockIdx.z;
    const int x0 = blockIdx.x * kTile - kSsimRadius, y0 = blockIdx.y * kTile - kSsimRadius;
    const std::size_t plane = std::size_t(width) * height;
    const int thread = threadIdx.y * kTile + threadIdx.x;
    for (int k = thread; k < kHalo * kHalo; k += kTile * kTile) {
        const int i = k % kHalo, j = k / kHalo, x = x0 + i, y = y0 + j;
        const bool inside = x >= 0 && y >= 0 && x < width && y < height;
        const float w = inside ? weight_at(a, x, y) : 0.0f;
        sx[j][i] = inside ? w * a.in.image[c * plane + std::size_t(y) * width + x] : 0.0f;
        sy[j][i] = inside ? w * target_at(a, c, x, y) : 0.0f;
    }
    __syncthreads();
    for (int k = thread; k < kHalo * kTile; k += kTile * kTile) {
        const int i = k % kTile, j = k / kTile;
        float s[5] = {};
#pragma unroll
        for (int t = -kSsimRadius; t <= kSsimRadius; ++t) {
            const float g = kTaps[t < 0 ? -t : t], p = sx[j][i + kSsimRadius + t], q = sy[j][i + kSsimRadius + t];
            s[0] += g * p, s[1] += g * q, s[2] += g * p * p, s[3] += g * q * q, s[4] += g * p * q;
        }
#pragma unroll
        for (int m = 0; m < 5; ++m) rows[m][j][i] = s[m];
    }
    __syncthreads();
    const int x = blockIdx.x * kTile + threadIdx.x, y = blockIdx.y * kTile + threadIdx.y;
    float weighted = 0;
    if (x < width && y < height) {
        float m[5];
#pragma unroll
        for (int k = 0; k < 5; ++k) m[k] = filter_at(&rows[k][threadIdx.y + kSsimRadius][threadIdx.x], kTile + 1);
        const SsimPixel<float> s = ssim_pixel(m[0], m[1], m[2], m[3], m[4]);
        const float w = weight_at(a, x, y), u = a.ssim_step * w;
        const std::size_t i = c * plane + std::size_t(y) * width + x;
        maps[i] = u * s.p;
        maps[i + 3 * plane] = u * s.q;
        maps[i + 6 * plane] = u * s.r;
        weighted = w * s.ssim;
    }
    add_block_sum(weighted, ssim_total);
}

__global__ void __launch_bounds__(kTile* kTile) loss_gradient(LossArgs a, const float* __restrict__ maps, float* __restrict__ dL_dimage, double* __restrict__ l1_total) {
    __shared__ float s[3][kHalo][kHalo + 1];
    __shared__ float rows[3][kHalo][kTile + 1];
    const int width = a.in.target.width, height = a.in.target.height, c = blockIdx.z;
    const int x0 = blockIdx.x * kTile - kSsimRadius, y0 = blockIdx.y * kTile - kSsimRadius;
    const std::size_t plane = std::size_t(width) * height;
    const int thread = threadIdx.y * kTile + threadIdx.x;
    for (int k = thread; k < kHalo * kHalo; k += kTile * kTile) {
        const int i = k % kHalo, j = k / kHalo, x = x0 + i, y = y0 + j;
        const bool inside = x >= 0 && y >= 0 && x < width && y < height;
        const std::size_t at = c * plane + std::size_t(y) * width + x;
#pragma unroll
        for (int m = 0; m < 3; ++m) s[m][j][i] = inside ? maps[at + 3 * m * plane] : 0.0f;
    }
    __syncthreads();
    for (int k = thread; k < kHalo * kTile; k += kTile * kTile) {
        const int i = k % kTile, j = k / kTile;
#pragma unroll
        for (int m = 0; m < 3; ++m) rows[m][j][i] = filter_at(&s[m][j][i + kSsimRadius], 1);
    }
    __syncthreads();
    const int x = blockIdx.x * kTile + threadIdx.x, y = blockIdx.y * kTile + threadIdx.y;
    float difference = 0;
    if (x < width && y < height) {
        float f[3];
#pragma unroll
        for (int m = 0; m < 3; ++m) f[m] = filter_at(&rows[m][threadIdx.y + kSsimRadius][threadIdx.x], kTile + 1);
        const std::size_t i = c * plane + std::size_t(y) * width + x;
        const float w = weight_at(a, x, y), p = w * a.in.image[i], t = w * target_at(a, c, x, y), d = p - t;
        const float sign = d > 0 ? 1.0f : (d < 0 ? -1.0f : 0.0f);
        difference = d * sign;
        dL_dimage[i] = w * (a.l1_step * sign + f[0] + 2.0f * p * f[1] + t * f[2]);
    }
    add_block_sum(difference, l1_total);
}

}  // namespace

void CudaLoss::compute(const CudaLossInput& in, float* dL_dimage, double* totals, cudaStream_t stream) {
    static const bool taps_uploaded = [] {
        const SsimTaps<float> taps;
        GS_CUDA(cudaMemcpyToSymbol(kTaps, taps.g, sizeof taps.g));
        return true;
    }();
    (void)taps_uploaded;
    const int w = in.target.width, h = in.target.height;
    const std::size_t pixels = std::size_t(w) * h;
    if (!(in.weight_sum > 0)) { // nothing is looked at
        GS_CUDA(cudaMemsetAsync(dL_dimage, 0, 3 * pixels * sizeof(float), stream));
        return;
    }
    float* maps = maps_.reserve(9 * pixels);
    const LossArgs args{in, float((1 - in.lambda_dssim) / (3 * in.weight_sum)), float(-in.lambda_dssim / (3 * in.weight_sum))};
    const dim3 grid(num_blocks(w, kTile), num_blocks(h, kTile), 3), block(kTile, kTile);
    ssim_maps<<<grid, block, 0, stream>>>(args, maps, totals + 1);
    GS_CUDA_LAUNCHED("ssim_maps");
    loss_gradient<<<grid, block, 0, stream>>>(args, maps, dL_dimage, totals);
    GS_CUDA_LAUNCHED("loss_gradient");
}

}  // namespace gs
