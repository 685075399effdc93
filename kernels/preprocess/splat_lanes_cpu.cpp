// SPDX-License-Identifier: Apache-2.0
#include "kernels/preprocess/splat_lanes_cpu.h"

#include <algorithm>

#include "kernels/preprocess/gaussian_device.h"

namespace gs {
namespace {

/// Loads `n` rows as vectors, one per column. Lanes from `n` on are 0.
template <int kWidth, class Real> void load_columns(const Real* rows, int n, Lanes<Real>* out) {
    Real padded[kWidth * kLanes];
    if (n < kLanes) {
        std::fill(std::copy_n(rows, n * kWidth, padded), std::end(padded), Real(0));
        rows = padded;
    }
    for (int c = 0; c < kWidth; ++c) {
        Real column[kLanes];
        for (int k = 0; k < kLanes; ++k) column[k] = rows[k * kWidth + c];
        out[c] = Lanes<Real>::load(column);
    }
}

template <class Real>
GaussianGeometry<Lanes<Real>> load_geometry(const ParameterView<Real>& params, std::int64_t first, int n) {
    Lanes<Real> m[3], s[3], q[4], o[1], f[1] = {};
    load_columns<3>(params.means + 3 * first, n, m);
    load_columns<3>(params.log_scales + 3 * first, n, s);
    load_columns<4>(params.rotations + 4 * first, n, q);
    load_columns<1>(params.raw_opacities + first, n, o);
    if (params.smoothing) load_columns<1>(params.smoothing + first, n, f);
    return {{m[0], m[1], m[2]}, {s[0], s[1], s[2]}, {q[0], q[1], q[2], q[3]}, o[0], f[0], params.antialiased};
}

/// Returns one coordinate of the corners of sixteen tiles; index(lane) is the tile's index along that axis.
template <class Real, class Index> Lanes<Real> tile_corners(Index index) {
    Real corners[kLanes];
    for (int lane = 0; lane < kLanes; ++lane) corners[lane] = Real(index(lane) * kCpuTile);
    return Lanes<Real>::load(corners);
}

/// Returns whether a coordinate lies between the first and the last pixel centre of a tile.
template <class Real> bool is_between(Real x, int corner) {
    return x >= Real(corner) + Real(0.5) && x <= Real(corner) + Real(kCpuTile - 0.5);
}

}  // namespace

template <class Real>
ViewLanes<Real> ViewLanes<Real>::of(const CameraParams<Real>& c, int width_padded, int height_padded,
                                    const Cutoffs<Real>& cutoffs) {
    using L = Lanes<Real>;
    return {converted<L>(c, [](Real x) { return L(x); }),
            L(Real(width_padded)),
            L(Real(height_padded)),
            L(cutoffs.alpha),
            L(cutoffs.inverse_alpha),
            c,
            cutoffs};
}

/// Computes the splats one by one, through a lens. Its functions have branches.
template <class Real>
unsigned make_splats_through_lens(const ParameterView<Real>& params, std::int64_t first, int n,
                                  const ViewLanes<Real>& view, SplatLanes<Real>& out) {
    unsigned shown = 0;
    for (int lane = 0; lane < n; ++lane) {
        Splat<Real> s;
        PixelBounds b;
        Real depth;
        if (!make_splat(params.geometry(first + lane), view.one, int(view.width_padded[0]), int(view.height_padded[0]),
                        s, b, depth, view.cutoffs, &out.lens_shapes[lane]))
            continue;
        shown |= 1u << lane;
        auto& to = out.splats;
        to.mean.x.set(lane, s.mean.x), to.mean.y.set(lane, s.mean.y);
        to.a.set(lane, s.a), to.b.set(lane, s.b), to.c.set(lane, s.c);
        to.opacity.set(lane, s.opacity), to.threshold.set(lane, s.threshold);
        out.bounds.x_min.set(lane, Real(b.x_min)), out.bounds.x_max.set(lane, Real(b.x_max));
        out.bounds.y_min.set(lane, Real(b.y_min)), out.bounds.y_max.set(lane, Real(b.y_max));
        out.depth.set(lane, depth);
    }
    return shown;
}

template <class Real>
unsigned make_splats(const ParameterView<Real>& params, std::int64_t first, const ViewLanes<Real>& view,
                     SplatLanes<Real>& out) {
    using L = Lanes<Real>;
    const int n = int(std::min<std::int64_t>(kLanes, params.count - first));
    if (!view.one.lens.is_pinhole()) return make_splats_through_lens(params, first, n, view, out);
    const GaussianGeometry<L> g = load_geometry(params, first, n);
    const CameraParams<L>& camera = view.camera;
    Projection<L> p;
    p.cam = camera.rotation * g.mean + camera.translation;
    const L depth = p.cam.z, q2 = norm2(g.rotation);
    // NaN fails every test.
    unsigned shown = ((1u << n) - 1) &
                     mask_bits(at_least(depth, camera.near_plane) & at_least(camera.far_plane, depth) &
                               at_least(q2, L(Real(kMinQuaternionNorm2))) & at_least(L(Real(kMaxQuaternionNorm2)), q2));
    if (!shown) return 0;
    project_shape(g, camera, p);
    auto& s = out.splats;
    set_shape(s, p, g);
    const L max_variance = L(Real(kMaxVariance2d));
    shown &= mask_bits(at_least(s.opacity, view.min_opacity) & at_least(p.det, L(Real(kMinDeterminant))) &
                       at_least(max_variance, p.cov2d.xx) & at_least(max_variance, p.cov2d.yy));
    if (!shown) return 0;
    s.mean = {camera.fx * p.u + camera.cx, camera.fy * p.v + camera.cy};
    s.threshold = splat_threshold(s.opacity, view.inverse_alpha);
    out.bounds = ellipse_bounds(s.mean, p.cov2d, touch_threshold(s), view.width_padded, view.height_padded);
    out.depth = depth;
    const L one(Real(1));  // bounds are integers
    return shown & mask_bits(at_least(out.bounds.x_max, out.bounds.x_min + one) &
                             at_least(out.bounds.y_max, out.bounds.y_min + one));
}

template <class Real>
std::uint32_t add_tiles(const Splat<Real>& s, const PixelBounds& b, int tiles_x, std::vector<std::uint32_t>& tiles) {
    using L = Lanes<Real>;
    static_assert(kCpuTile == kTileWidth);
    constexpr int kSide = 4;  // one lane operation tests 4x4 tiles
    static_assert(kSide * kSide == kLanes);
    const int x_begin = b.x_min / kCpuTile, x_end = (b.x_max + kCpuTile - 1) / kCpuTile;
    const int y_begin = b.y_min / kCpuTile, y_end = (b.y_max + kCpuTile - 1) / kCpuTile;
    if (x_end > tiles_x) {  // across the seam
        for (int y = y_begin; y < y_end; ++y)
            for (int x = x_begin; x < x_end; ++x) tiles.push_back(std::uint32_t(y) * tiles_x + x % tiles_x);
        return std::uint32_t((y_end - y_begin) * (x_end - x_begin));
    }
    // Most Gaussians are small: their only tile contains the mean, where the power is 0.
    if (x_end - x_begin == 1 && y_end - y_begin == 1 && is_between(s.mean.x, x_begin * kCpuTile) &&
        is_between(s.mean.y, y_begin * kCpuTile)) {
        tiles.push_back(std::uint32_t(y_begin) * tiles_x + x_begin);
        return 1;
    }
    const std::size_t before = tiles.size();
    const L corner_x = tile_corners<Real>([](int lane) { return lane % kSide; }),
            corner_y = tile_corners<Real>([](int lane) { return lane / kSide; }), threshold(touch_threshold(s));
    for (int y = y_begin; y < y_end; y += kSide)
        for (int x = x_begin; x < x_end; x += kSide) {
            const L power =
                min_power_in_rectangle(s, corner_x + L(Real(x * kCpuTile)), corner_y + L(Real(y * kCpuTile)),
                                       Real(kCpuTile - 1), Real(kCpuTile - 1));
            const unsigned columns = 0x1111u * ((1u << std::min(kSide, x_end - x)) - 1),
                           rows = (1u << kSide * std::min(kSide, y_end - y)) - 1;
            for (unsigned touched = mask_bits(at_least(threshold, power)) & columns & rows; touched;
                 touched &= touched - 1) {
                const int lane = __builtin_ctz(touched);
                tiles.push_back(std::uint32_t(y + lane / kSide) * tiles_x + x + lane % kSide);
            }
        }
    return std::uint32_t(tiles.size() - before);
}

#define GS_INSTANTIATE(Real)                                                                        \
    template struct ViewLanes<Real>;                                                                \
    template unsigned make_splats(const ParameterView<Real>&, std::int64_t, const ViewLanes<Real>&, \
                                  SplatLanes<Real>&);                                               \
    template std::uint32_t add_tiles(const Splat<Real>&, const PixelBounds&, int, std::vector<std::uint32_t>&);
GS_INSTANTIATE(float)
GS_INSTANTIATE(double)
#undef GS_INSTANTIATE

}  // namespace gs
