// SPDX-License-Identifier: Apache-2.0
// Blends one 16x16 tile on the CPU, sixteen pixels (a 4x4 block) per lane operation.
//
// The Gaussians of a tile are processed front to back. A lane operation tests all 16 blocks of the tile at once, and
// only the touched blocks are evaluated. The test is conservative, so it never changes which fragments count.
#pragma once

#include <algorithm>

#include "kernels/blend/blend_device.h"
#include "kernels/splat/depth_key.h"
#include "kernels/splat/projection_device.h"

namespace gs {

/// The position of a tile and its inputs.
template <class Real> struct TileInput {
    int x0, y0;                 ///< first pixel
    int width, height;          ///< size of the image
    const Instance* instances;  ///< instances of this tile, front to back
    std::int64_t num_instances;
    const Splat<Real>* splats;  ///< splats of all Gaussians
    Vec3<Real> background;
    Cutoffs<Real> cutoffs;
    Real period = 0;                               ///< as in CameraParams
    const LensShape<Real>* lens_shapes = nullptr;  ///< of all Gaussians, through a lens; else null
    Real face_focal = 0;                           ///< as in CameraParams
    bool as_pinholes = false;                      ///< as in Lens
    const Real* rays = nullptr;                    ///< (3,H,W) unit rays of the pixels, through a lens

    /// Returns the splat of an instance, at the place that is nearest to the tile if the image repeats.
    Splat<Real> splat(std::int64_t k) const {
        Splat<Real> s = splats[instances[k].gaussian];
        if (period > 0) s.mean.x = nearest_repeat(s.mean.x, Real(x0 + kCpuTile / 2), period);
        return s;
    }
};

inline constexpr int kTilePixels = kCpuTile * kCpuTile;

template <class Real> struct BlockGeometry {
    Lanes<Real> px[4], py[4];      ///< pixel centres of block column / row 0..3
    Lanes<Real> block_x, block_y;  ///< first pixel of each of the 16 blocks

    BlockGeometry(int x0, int y0) {
        for (int lane = 0; lane < kLanes; ++lane) {
            block_x.set(lane, Real(x0 + kCpuBlock * (lane % 4)));
            block_y.set(lane, Real(y0 + kCpuBlock * (lane / 4)));
            for (int k = 0; k < 4; ++k) {
                px[k].set(lane, Real(x0 + kCpuBlock * k + lane % 4) + Real(0.5));
                py[k].set(lane, Real(y0 + kCpuBlock * k + lane / 4) + Real(0.5));
            }
        }
    }

    /// Returns the touched blocks: bit b is set if block b may contain a pixel with alpha at the cutoff or above.
    unsigned touched(const Splat<Real>& s) const {
        const Lanes<Real> power = min_power_in_rectangle(s, block_x, block_y, Real(kCpuBlock - 1), Real(kCpuBlock - 1));
        return mask_bits(at_least(Lanes<Real>(touch_threshold(s)), power));
    }
};

/// Returns the index of pixel (x,y) of a tile in block order.
inline int block_order(int x, int y) { return ((y / 4) * 4 + x / 4) * 16 + (y % 4) * 4 + x % 4; }

/// The fragments of a tile's splats in its blocks of pixels, with a lens or without.
template <class Real> class TileFragments {
  public:
    using L = Lanes<Real>;
    explicit TileFragments(const TileInput<Real>& in) : in_(in), blocks_(in.x0, in.y0) {
        if (!in.rays) return;
        const std::size_t plane = std::size_t(in.width) * in.height;
        for (int y = 0; y < kCpuTile; ++y)
            for (int x = 0; x < kCpuTile; ++x) {
                const int px = std::min(in.x0 + x, in.width - 1), py = std::min(in.y0 + y, in.height - 1);
                const std::size_t i = std::size_t(py) * in.width + px;
                for (int c = 0; c < 3; ++c) rays_[c][block_order(x, y)] = in.rays[i + std::size_t(c) * plane];
            }
    }
    /// Begins with the splat of an instance, and returns it.
    const Splat<Real>& begin(std::int64_t k) {
        splat_ = in_.splat(k);
        shape_ = FragmentShape<L>::from(splat_);
        if (in_.rays) {
            const LensShape<Real>& s = in_.lens_shapes[in_.instances[k].gaussian];
            lens_shape_ = {L(s.mx), L(s.my), L(s.qa),
                           L(s.qb), L(s.qc), {L(s.forward.x), L(s.forward.y), L(s.forward.z)},
                           s.axis,  s.wide};
            if (!(axes_ >> s.axis & 1)) find_rays(s.axis);
        }
        return splat_;
    }
    /// Returns BlockGeometry::touched of the splat.
    unsigned touched() const { return blocks_.touched(splat_); }
    /// Calls f with the splat's fragments in a block: a FragmentAlpha or a LensFragment.
    template <class F> void in_block(int block, F&& f) const {
        if (!in_.rays) return f(fragment_alpha(shape_, blocks_.px[block % 4], blocks_.py[block / 4]));
        const int at = block * kLanes;
        const auto& rays = face_rays_[lens_shape_.axis];
        f(lens_fragment_alpha<Real>(lens_shape_, shape_.opacity,
                                    FaceRay<L>{L::load(rays[0] + at), L::load(rays[1] + at), L::load(rays[2] + at)}));
    }
    L alpha(int block) const {
        L alpha(Real(0));
        in_block(block, [&](const auto& f) { alpha = f.alpha; });
        return alpha;
    }

  private:
    void find_rays(int axis) {
        for (int at = 0; at < kTilePixels; at += kLanes) {
            const FaceRay<L> ray =
                face_ray(Vec3<L>{L::load(rays_[0] + at), L::load(rays_[1] + at), L::load(rays_[2] + at)}, axis,
                         in_.face_focal, in_.as_pinholes);
            ray.x.store(face_rays_[axis][0] + at), ray.y.store(face_rays_[axis][1] + at);
            ray.w.store(face_rays_[axis][2] + at);
        }
        axes_ |= 1u << axis;
    }

    const TileInput<Real>& in_;
    const BlockGeometry<Real> blocks_;
    alignas(64) Real rays_[3][kTilePixels];
    alignas(64) Real face_rays_[kFaceAxes][3][kTilePixels];  ///< as in FaceRay, found when a splat needs them
    unsigned axes_ = 0;                                      ///< axes with rays, as bits
    Splat<Real> splat_;
    FragmentShape<L> shape_;
    LensShape<L> lens_shape_;
};

/// Blends a tile. Writes colour (planar, plane stride width*height) and final transmittance of the tile's pixels, and
/// to block_masks[k] the blocks in which instance k was evaluated. Returns the number of instances processed until
/// every pixel was finished; later masks are not written.
template <class Real>
std::int64_t blend_tile(const TileInput<Real>& in, std::uint16_t* block_masks, Real* image, Real* transmittance) {
    using L = Lanes<Real>;
    TileFragments<Real> fragments(in);
    alignas(64) Real t[kTilePixels], r[kTilePixels] = {}, g[kTilePixels] = {}, b[kTilePixels] = {};
    unsigned open = 0;  // blocks with an unfinished pixel
    for (int y = 0; y < kCpuTile; ++y)
        for (int x = 0; x < kCpuTile; ++x) {
            const bool inside = in.x0 + x < in.width && in.y0 + y < in.height;
            t[block_order(x, y)] = inside ? Real(1) : Real(0);
            if (inside) open |= 1u << (block_order(x, y) / kLanes);
        }
    std::int64_t k = 0;
    for (; k < in.num_instances && open; ++k) {
        const Splat<Real>& s = fragments.begin(k);
        unsigned mask = fragments.touched() & open;
        block_masks[k] = static_cast<std::uint16_t>(mask);
        if (!mask) continue;
        const L cr(s.color.x), cg(s.color.y), cb(s.color.z);
        for (; mask; mask &= mask - 1) {
            const int block = __builtin_ctz(mask), at = block * kLanes;
            PixelForward<L> p{L::load(t + at), L::load(r + at), L::load(g + at), L::load(b + at)};
            blend_fragment<L, Real>(p, fragments.alpha(block), cr, cg, cb, in.cutoffs);
            p.t.store(t + at);
            p.r.store(r + at);
            p.g.store(g + at);
            p.b.store(b + at);
            if (!mask_bits(at_least(p.t, L(in.cutoffs.transmittance)))) open &= ~(1u << block);
        }
    }
    const std::size_t plane = std::size_t(in.width) * in.height;
    for (int y = 0; y < std::min(kCpuTile, in.height - in.y0); ++y)
        for (int x = 0; x < std::min(kCpuTile, in.width - in.x0); ++x) {
            const int p = block_order(x, y);
            const std::size_t i = std::size_t(in.y0 + y) * in.width + in.x0 + x;
            image[i] = r[p] + t[p] * in.background.x;
            image[i + plane] = g[p] + t[p] * in.background.y;
            image[i + 2 * plane] = b[p] + t[p] * in.background.z;
            transmittance[i] = t[p];
        }
    return k;
}

/// Computes the gradients for the instances that the forward pass processed, and writes their sums to sums[slot].
template <class Real>
void blend_tile_backward(const TileInput<Real>& in, std::int64_t num_processed, const std::uint16_t* block_masks,
                         const Real* image, const Real* transmittance, const Real* dL_dimage, SplatSums<Real>* sums) {
    using L = Lanes<Real>;
    TileFragments<Real> fragments(in);
    alignas(64) Real t[kTilePixels], behind[kTilePixels], gr[kTilePixels], gg[kTilePixels], gb[kTilePixels],
        background[kTilePixels];
    const std::size_t plane = std::size_t(in.width) * in.height;
    for (int y = 0; y < kCpuTile; ++y)
        for (int x = 0; x < kCpuTile; ++x) {
            const int p = block_order(x, y);
            t[p] = behind[p] = gr[p] = gg[p] = gb[p] = background[p] = Real(0);
            if (in.x0 + x >= in.width || in.y0 + y >= in.height) continue;
            const std::size_t i = std::size_t(in.y0 + y) * in.width + in.x0 + x;
            t[p] = Real(1);
            gr[p] = dL_dimage[i];
            gg[p] = dL_dimage[i + plane];
            gb[p] = dL_dimage[i + 2 * plane];
            background[p] =
                transmittance[i] * (gr[p] * in.background.x + gg[p] * in.background.y + gb[p] * in.background.z);
            behind[p] = image[i] * gr[p] + image[i + plane] * gg[p] + image[i + 2 * plane] * gb[p];
        }
    for (std::int64_t k = 0; k < in.num_instances; ++k) {
        SplatSums<Real>& out = sums[in.instances[k].slot];
        unsigned mask = k < num_processed ? block_masks[k] : 0;
        if (!mask) {
            out = SplatSums<Real>{};
            continue;
        }
        const Splat<Real>& s = fragments.begin(k);
        const L cr(s.color.x), cg(s.color.y), cb(s.color.z), zero(Real(0));
        SplatSums<L> sum{zero, zero, zero, zero, zero, zero, zero, zero, zero};
        for (; mask; mask &= mask - 1) {
            const int block = __builtin_ctz(mask), at = block * kLanes;
            PixelBackward<L> p{L::load(t + at),  L::load(behind + at), L::load(gr + at),
                               L::load(gg + at), L::load(gb + at),     L::load(background + at)};
            fragments.in_block(
                block, [&](const auto& f) { blend_fragment_backward<L, Real>(p, f, cr, cg, cb, in.cutoffs, sum); });
            p.t.store(t + at);
            p.behind.store(behind + at);
        }
        out = {sum_lanes(sum.h),   sum_lanes(sum.hx), sum_lanes(sum.hy), sum_lanes(sum.hxx), sum_lanes(sum.hxy),
               sum_lanes(sum.hyy), sum_lanes(sum.r),  sum_lanes(sum.g),  sum_lanes(sum.b)};
    }
}

// The medians of one 16x16 tile on the CPU (docs/math/rasterizer.md#median).

/// Writes the colour of each pixel's median to image, planar (3,H,W), for a tile already processed by blend_tile; 0 if
/// transmittance stays above 1/2.
template <class Real>
void median_tile(const TileInput<Real>& in, std::int64_t num_processed, const std::uint16_t* block_masks, Real* image) {
    using L = Lanes<Real>;
    TileFragments<Real> fragments(in);
    alignas(64) Real t[kTilePixels], r[kTilePixels] = {}, g[kTilePixels] = {}, b[kTilePixels] = {};
    std::fill_n(t, kTilePixels, Real(1));
    for (std::int64_t k = 0; k < num_processed; ++k) {
        const Splat<Real>& s = fragments.begin(k);
        const L cr(s.color.x), cg(s.color.y), cb(s.color.z);
        for (unsigned mask = block_masks[k]; mask; mask &= mask - 1) {
            const int block = __builtin_ctz(mask), at = block * kLanes;
            PixelForward<L> p{L::load(t + at), L::load(r + at), L::load(g + at), L::load(b + at)};
            pass_median<L, Real>(p, fragments.alpha(block), cr, cg, cb, in.cutoffs);
            p.t.store(t + at);
            p.r.store(r + at);
            p.g.store(g + at);
            p.b.store(b + at);
        }
    }
    const std::size_t plane = std::size_t(in.width) * in.height;
    for (int y = 0; y < std::min(kCpuTile, in.height - in.y0); ++y)
        for (int x = 0; x < std::min(kCpuTile, in.width - in.x0); ++x) {
            const int p = block_order(x, y);
            const std::size_t i = std::size_t(in.y0 + y) * in.width + in.x0 + x;
            image[i] = r[p], image[i + plane] = g[p], image[i + 2 * plane] = b[p];
        }
}

// Scores the Gaussians of one 16x16 tile on the CPU (docs/math/densification.md#pruning-by-score).

/// Writes the sums of (dI/dG)^2 over the tile's pixels to sums[slot], for the instances that blend_tile has processed.
/// image: planar (3,H,W); transmittance: (H,W).
template <class Real>
void score_tile(const TileInput<Real>& in, std::int64_t num_processed, const std::uint16_t* block_masks,
                const Real* image, const Real* transmittance, Real* sums) {
    using L = Lanes<Real>;
    TileFragments<Real> fragments(in);
    alignas(64) Real t[kTilePixels] = {}, behind[kTilePixels] = {}, background[kTilePixels] = {};
    const std::size_t plane = std::size_t(in.width) * in.height;
    for (int y = 0; y < std::min(kCpuTile, in.height - in.y0); ++y)
        for (int x = 0; x < std::min(kCpuTile, in.width - in.x0); ++x) {
            const int p = block_order(x, y);
            const std::size_t i = std::size_t(in.y0 + y) * in.width + in.x0 + x;
            const auto pixel = PixelScore<Real>::of(Vec3<Real>{image[i], image[i + plane], image[i + 2 * plane]},
                                                    transmittance[i], in.background);
            t[p] = pixel.t, behind[p] = pixel.behind, background[p] = pixel.background;
        }
    for (std::int64_t k = 0; k < in.num_instances; ++k) {
        const Splat<Real>& s = fragments.begin(k);
        const L color_sum(s.color.x + s.color.y + s.color.z), opacity(s.opacity);
        L sum(Real(0));
        for (unsigned mask = k < num_processed ? block_masks[k] : 0; mask; mask &= mask - 1) {
            const int block = __builtin_ctz(mask), at = block * kLanes;
            PixelScore<L> p{L::load(t + at), L::load(behind + at), L::load(background + at)};
            sum = sum + fragment_score<L, Real>(p, fragments.alpha(block), opacity, color_sum, in.cutoffs);
            p.t.store(t + at);
            p.behind.store(behind + at);
        }
        sums[in.instances[k].slot] = sum_lanes(sum);
    }
}

}  // namespace gs
