// SPDX-License-Identifier: Apache-2.0
// The splats that preprocessing passes to sorting and blending on the device, the tiles that they touch, and the order
// of instances that sorting passes to blending.
#pragma once

#include <cstdint>

#include "kernels/cuda/cuda.h"
#include "kernels/splat/projection_device.h"

namespace gs {

/// A tile of the CUDA blend has 16x12 pixels, covered by six warps of 8x4 pixels.
inline constexpr int kCudaTileX = kTileWidth, kCudaTileY = 12, kCudaTilePixels = kCudaTileX * kCudaTileY;

/// LensShape::axis and LensShape::wide with the sign of forward.z, in one word.
struct LensWord {
    unsigned word;

    static constexpr unsigned kAxis = 3, kWide = 4, kSign = 0x80000000u;

    static __device__ LensWord of(const LensShape<float>& s) {
        return {unsigned(s.axis) | (s.wide ? kWide : 0) | (__float_as_uint(s.forward.z) & kSign)};
    }
    __device__ int axis() const { return int(word & kAxis); }
    __device__ bool is_wide() const { return word & kWide; }
    __device__ float forward_z() const { return __uint_as_float((word & kSign) | 0x3f800000u); }
    /// Returns bits that are 0 if a splat is on this axis and not wide.
    __device__ unsigned differs_from(int axis) const { return (word ^ unsigned(axis)) & (kAxis | kWide); }
};

/// The shape of a splat through a lens; its PackedSplat holds the outline.
struct alignas(16) PackedLensShape {
    float4 a;  ///< as in PackedSplat, on the face
    float4 b;  ///< qc, LensWord, forward.x, forward.y

    static __device__ PackedLensShape of(const LensShape<float>& s) {
        return {make_float4(s.mx, s.my, s.qa, s.qb),
                make_float4(s.qc, __uint_as_float(LensWord::of(s).word), s.forward.x, s.forward.y)};
    }
    __device__ LensShape<float> shape() const {
        const LensWord w{__float_as_uint(b.y)};
        return {a.x, a.y, a.z, a.w, b.x, {b.z, b.w, w.forward_z()}, w.axis(), w.is_wide()};
    }
};

/// A splat in three 16-byte pieces, so that three instructions read it and no memory sector is shared needlessly. Its
/// conic is scaled once for all pixels, as in FragmentShape.
struct alignas(16) PackedSplat {
    float4 a;  ///< mean x, mean y, qa, qb
    float4 b;  ///< qc, opacity, threshold, red
    float4 c;  ///< green, blue, and the pixel bounds: x_min | x_max << 16, y_min | y_max << 16

    static __device__ PackedSplat of(const Splat<float>& s, const PixelBounds& p) {
        const FragmentShape<float> f = FragmentShape<float>::from(s);
        return {make_float4(f.mx, f.my, f.qa, f.qb), make_float4(f.qc, f.opacity, s.threshold, s.color.x),
                make_float4(s.color.y, s.color.z, __uint_as_float(p.x_min | p.x_max << 16),
                            __uint_as_float(p.y_min | p.y_max << 16))};
    }
    __device__ FragmentShape<float> shape() const { return {a.x, a.y, a.z, a.w, b.x, b.y}; }
    __device__ Vec3<float> color() const { return {b.w, c.x, c.y}; }
    __device__ void set_color(const Vec3<float>& color) { b.w = color.x, c.x = color.y, c.y = color.z; }
    /// Returns the splat with its conic unscaled, exact up to rounding.
    __device__ Splat<float> splat() const {
        constexpr float kUnscale = float(-2 / kLog2E);
        return {{a.x, a.y}, kUnscale * a.z, 0.5f * kUnscale * a.w, kUnscale * b.x, b.y, color(), b.z};
    }
    __device__ PixelBounds bounds() const {
        const unsigned x = __float_as_uint(c.z), y = __float_as_uint(c.w);
        return {int(x & 0xffff), int(x >> 16), int(y & 0xffff), int(y >> 16)};
    }
    /// Replaces the outline of a splat through a lens, with its threshold and bounds, by its shape: for blending.
    __device__ void set_lens_shape(const PackedLensShape& s) {
        a = s.a, b.x = s.b.x, b.z = s.b.z, c.z = s.b.w, c.w = s.b.y;
    }
    /// Returns what set_lens_shape() has set.
    __device__ LensWord lens_word() const { return {__float_as_uint(c.w)}; }
    __device__ LensShape<float> lens_shape() const {
        return PackedLensShape{a, make_float4(b.x, c.w, b.z, c.z)}.shape();
    }
};

/// The tiles that overlap a pixel rectangle.
struct TileRectangle {
    int x0, y0, width, height;
    __device__ explicit TileRectangle(const PixelBounds& b)
        : x0(b.x_min / kCudaTileX),
          y0(b.y_min / kCudaTileY),
          width((b.x_max + kCudaTileX - 1) / kCudaTileX - x0),
          height((b.y_max + kCudaTileY - 1) / kCudaTileY - y0) {}
    __device__ int size() const { return width * height; }
    /// Returns whether it crosses the seam of a 360-degree image (wrapped_bounds()).
    __device__ bool crosses(int tiles_x) const { return x0 + width > tiles_x; }
};

/// The tiles that a Gaussian touches, found once: up to 32 candidate tiles as bits, row by row. Larger Gaussians have
/// width 0 and are tested again when their instances are written.
struct TileSpan {
    std::uint32_t where;  ///< x0 | y0 << 13 | width << 26
    std::uint32_t mask;

    static __device__ TileSpan of(const TileRectangle& r, unsigned mask) {
        return {std::uint32_t(r.x0) | std::uint32_t(r.y0) << 13 | std::uint32_t(r.size() <= 32 ? r.width : 0) << 26,
                mask};
    }
    __device__ int x0() const { return where & 0x1fff; }
    __device__ int y0() const { return where >> 13 & 0x1fff; }
    __device__ int width() const { return where >> 26; }
};

/// The ellipse {power <= touch threshold} of a splat, row by row. Between two rows the right-hand boundary is concave,
/// so its maximum x lies at the ellipse's rightmost point or at the nearer row. The left-hand boundary is symmetric.
class EllipseRows {
  public:
    __device__ explicit EllipseRows(const Splat<float>& s)
        : my_(s.mean.y), inverse_a_(1 / s.a), slope_(-s.b * inverse_a_) {
        // ac - b^2 cancels for needles, so the rounding error of b^2 is added back.
        const float b2 = __fmul_rn(s.b, s.b);
        curvature_ = (__fmaf_rn(s.a, s.c, -b2) + __fmaf_rn(-s.b, s.b, b2)) * inverse_a_;
        reach_ = 2 * touch_threshold(s);
        const bool bounded = curvature_ > 0;
        half_height_ = bounded ? sqrtf(reach_ / curvature_) : 3e38f;
        extreme_ = bounded ? slope_ * sqrtf(reach_ * s.a / (curvature_ * s.c)) : copysignf(3e38f, slope_);
    }
    struct Reach {
        float left, right;
        __device__ bool meets(float from, float to) const { return right >= from && left <= to; }
    };
    /// Returns the smallest and largest x of the ellipse between two rows, relative to its mean; left > right if no
    /// part of it lies between them.
    __device__ Reach between(float y_low, float y_high) const {
        const float from = fmaxf(y_low - my_, -half_height_), to = fminf(y_high - my_, half_height_);
        if (!(from <= to)) return {3e38f, -3e38f};
        const float y_right = fminf(fmaxf(extreme_, from), to), y_left = fminf(fmaxf(-extreme_, from), to);
        return {slope_ * y_left - half_width(y_left), slope_ * y_right + half_width(y_right)};
    }

  private:
    __device__ float half_width(float dy) const {
        return sqrtf(fmaxf(reach_ - dy * dy * curvature_, 0.0f) * inverse_a_);
    }
    float my_, inverse_a_, slope_, curvature_, reach_, half_height_, extreme_;
};

/// Finds the tiles [x0, x1) of a row that a splat's ellipse overlaps: all of a rectangle across the seam.
class TileRows {
  public:
    __device__ TileRows(const Splat<float>& s, const TileRectangle& r, int tiles_x)
        : ellipse_(s), mx_(s.mean.x), x0_(r.x0), x1_(r.x0 + r.width), crosses_(r.crosses(tiles_x)) {}
    struct Span {
        int x0, x1;
        __device__ int size() const { return x1 - x0; }
    };
    __device__ Span row(int ty) const {
        if (crosses_) return {x0_, x1_};
        const float low = ty * kCudaTileY + 0.5f;
        const EllipseRows::Reach reach = ellipse_.between(low, low + (kCudaTileY - 1));
        if (reach.left > reach.right) return {0, 0};
        const float left = mx_ + reach.left, right = mx_ + reach.right;
        // Clamped as floating point: an ellipse may extend beyond the range of int.
        const int x0 = int(fmaxf(ceilf((left - (kCudaTileX - 0.5f)) * (1.0f / kCudaTileX)), float(x0_)));
        const int x1 = int(fminf(floorf((right - 0.5f) * (1.0f / kCudaTileX)), float(x1_ - 1))) + 1;
        return {x0, x1 > x0 ? x1 : x0};
    }

  private:
    EllipseRows ellipse_;
    float mx_;
    int x0_, x1_;
    bool crosses_;
};

/// Returns the span of row y + lane; rows from y_end on have empty spans. There is only one copy of this code: counting
/// and writing the instances of large Gaussians must agree bit for bit, or slots stay unwritten.
__device__ __noinline__ inline TileRows::Span span_of_lane(const PackedSplat& p, int y, int y_end, int tiles_x) {
    const TileRectangle r(p.bounds());
    const int ty = y + int(threadIdx.x & 31);
    return ty < y_end ? TileRows(p.splat(), r, tiles_x).row(ty) : TileRows::Span{0, 0};
}

/// A unit of work on tiles: a whole tile or, if its list is long, a quarter of each of its sub-tiles.
struct TileItem {
    std::uint32_t word = kNone;

    static constexpr std::uint32_t kNone = 0xffffffff;

    __device__ static TileItem whole(std::uint32_t tile) { return {tile << 3}; }
    __device__ static TileItem part(std::uint32_t tile, int quarter) { return {tile << 3 | 4 | quarter}; }
    __device__ bool is_none() const { return word == kNone; }
    __device__ bool is_whole() const { return !(word & 4); }
    __device__ int tile() const { return int(word >> 3); }
    __device__ int quarter() const { return int(word & 3); }
    __device__ bool is_first_of_tile() const { return !is_none() && quarter() == 0; }
};
/// A tile with more than 1/kMostQuartered of a view's instances is processed in quarters, so there are at most this
/// many such tiles. Quarters are more work in total, but end sooner: with 320, 450, 640 and 1280 the forward pass took
/// 0.163, 0.155, 0.168 and 0.202 ms on lego (0.175 without) and 0.284, 0.275, 0.280 and 0.307 ms on bonsai (0.329).
inline constexpr int kMostQuartered = 450;

/// The instances of a view in blending order. All pointers are on the device.
struct CudaBins {
    int tiles_x = 0, tiles_y = 0;
    /// Gaussians by tile and depth; slots instead if `gaussians` is set.
    const std::uint32_t* instances = nullptr;
    const std::uint32_t* gaussians = nullptr;     ///< Gaussian of each slot; set only if sums have a fixed order
    const std::uint32_t* tile_offsets = nullptr;  ///< (tiles+1)
    /// (num_items()) work items, longest first (approximately), so that no long list is left for last; then empty
    /// items.
    const TileItem* longest_first = nullptr;

    __host__ __device__ int num_tiles() const { return tiles_x * tiles_y; }
    int num_items() const { return num_tiles() + 3 * (num_tiles() < kMostQuartered ? num_tiles() : kMostQuartered); }
};

/// The slots of each Gaussian, which are consecutive: the slots of the k-th Gaussian in depth order end at
/// slot_ends[k].
struct SlotMap {
    const std::uint32_t *order, *slot_ends;
};

}  // namespace gs
