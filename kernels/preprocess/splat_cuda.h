// SPDX-License-Identifier: Apache-2.0
// What preprocessing hands to sorting and blending on the device, and the counters of a step.
#pragma once

#include "kernels/blend/blend_device.h"
#include "kernels/core/cuda.h"

namespace gs {

/// Tiles of the CUDA blend: 16x12 pixels, six warps of 8x4 pixels each.
inline constexpr int kCudaTileX = 16, kCudaTileY = 12, kCudaTilePixels = kCudaTileX * kCudaTileY;

/// A splat in three 16-byte pieces, so that it is read with three instructions and shares no sector needlessly.
struct alignas(16) PackedSplat {
    float4 a; ///< mean x, mean y, conic a, conic b
    float4 b; ///< conic c, opacity, threshold, red
    float4 c; ///< green, blue, and the pixel bounds: x_min | x_max << 16, y_min | y_max << 16

    static __device__ PackedSplat of(const Splat<float>& s, const PixelBounds& p) {
        return {make_float4(s.mean.x, s.mean.y, s.a, s.b), make_float4(s.c, s.opacity, s.threshold, s.color.x),
                make_float4(s.color.y, s.color.z, __uint_as_float(p.x_min | p.x_max << 16), __uint_as_float(p.y_min | p.y_max << 16))};
    }
    __device__ Splat<float> splat() const { return {{a.x, a.y}, a.z, a.w, b.x, b.y, {b.w, c.x, c.y}, b.z}; }
    __device__ PixelBounds bounds() const {
        const unsigned x = __float_as_uint(c.z), y = __float_as_uint(c.w);
        return {int(x & 0xffff), int(x >> 16), int(y & 0xffff), int(y >> 16)};
    }
};

/// Tiles that a pixel rectangle meets.
struct TileRectangle {
    int x0, y0, width, height;
    __device__ explicit TileRectangle(const PixelBounds& b)
        : x0(b.x_min / kCudaTileX), y0(b.y_min / kCudaTileY), width((b.x_max + kCudaTileX - 1) / kCudaTileX - x0),
          height((b.y_max + kCudaTileY - 1) / kCudaTileY - y0) {}
    __device__ int size() const { return width * height; }
};

/// The tiles a Gaussian touches, found once: up to 32 candidate tiles as bits, row by row. Larger ones (width 0) are tested
/// again when their instances are written.
struct TileSpan {
    std::uint32_t where; ///< x0 | y0 << 13 | width << 26
    std::uint32_t mask;

    static __device__ TileSpan of(const TileRectangle& r, unsigned mask) {
        return {std::uint32_t(r.x0) | std::uint32_t(r.y0) << 13 | std::uint32_t(r.size() <= 32 ? r.width : 0) << 26, mask};
    }
    __device__ int x0() const { return where & 0x1fff; }
    __device__ int y0() const { return where >> 13 & 0x1fff; }
    __device__ int width() const { return where >> 26; }
};

/// Whether a splat reaches a pixel centre of a tile. One copy of the code: counting and writing the instances of large
/// Gaussians must agree bit for bit, or slots stay unwritten.
__device__ __noinline__ inline bool touches_tile(float mx, float my, float a, float b, float c, float threshold, int tx, int ty) {
    const Splat<float> s{{mx, my}, a, b, c, 0, {0, 0, 0}, threshold};
    return min_power_in_rectangle(s, float(tx * kCudaTileX), float(ty * kCudaTileY), float(kCudaTileX - 1), float(kCudaTileY - 1)) <= touch_threshold(s);
}

/// Depth as a sort key: the bits of a positive float order like the float; near and far leave less than 32 of them.
/// The lowest are dropped until 24 are left: three passes of sorting instead of four, for a depth resolution of 1e-6.
inline constexpr int kDepthKeyBits = 24;
struct DepthKey {
    std::uint32_t near_bits, shift;
    static DepthKey of(float near_plane, float far_plane) {
        const auto bits = [](float x) {
            std::uint32_t u;
            __builtin_memcpy(&u, &x, 4);
            return u;
        };
        DepthKey k{bits(near_plane), 0};
        while (((bits(far_plane) - k.near_bits) >> k.shift) + 1 >= (1u << kDepthKeyBits)) ++k.shift;
        return k;
    }
    __device__ std::uint32_t operator()(float depth) const { return (__float_as_uint(depth) - near_bits) >> shift; }
};
inline constexpr std::uint32_t kCulledKey = (1u << kDepthKeyBits) - 1;

/// Counters of the step in flight, on the device. All but `stopped` are zeroed before every step.
struct StepControl {
    unsigned long long num_instances; ///< Gaussian-tile pairs
    unsigned long long num_pairs;     ///< Gaussian-sub-tile pairs that were blended, 32 pixels each
    double l1, ssim;                  ///< sums of the weighted differences and SSIM
    unsigned num_visible;
    unsigned num_checkpoints, num_chunks; ///< of the blend
    unsigned num_nonfinite;           ///< Gaussians whose gradient was left out
    unsigned loss_blocks;
    unsigned stopped;                 ///< instances did not fit: nothing is updated until the host has made room
};

}  // namespace gs
