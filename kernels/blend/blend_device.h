// SPDX-License-Identifier: Apache-2.0
// The blending of one fragment, which is a Gaussian at a pixel (docs/math/rasterizer.md#blending), and its gradient
// (docs/math/rasterizer.md#blend-gradient).
//
// P is a scalar (one pixel) or Lanes (sixteen pixels); this code does not depend on which.
#pragma once

#include "kernels/base/lanes.h"
#include "kernels/splat/lens_device.h"
#include "kernels/splat/raster_config.h"
#include "kernels/splat/splat_device.h"

namespace gs {

/// Largest score of one fragment. Larger scores come from colours that no image holds.
inline constexpr double kLargestScore = 1e30;

template <class P> struct FragmentAlpha {
    P dx, dy;  ///< splat mean - pixel centre
    P alpha;   ///< alpha before the comparison with the cutoff
};

/// Returns alpha of a splat at pixel centres (px, py). The forward and backward pass both call this function, so that
/// they agree on which fragments count.
template <class P> GS_HD FragmentAlpha<P> fragment_alpha(const FragmentShape<P>& s, P px, P py) {
    const P dx = s.mx - px, dy = s.my - py;
    // Terms of dx alone come first: the backward pass on the device computes them once for a column of pixels.
    return {dx, dy, s.opacity * exp2_nonpositive(gs_fma(dy, gs_fma(s.qc, dy, s.qb * dx), s.qa * dx * dx))};
}

/// A fragment through a lens.
template <class P> struct LensFragment : FragmentAlpha<P> {
    P w;  ///< FaceRay::w
};

/// Returns the offset of a pixel's ray from the mean of a splat, pixels of the face.
template <class P> GS_HD Vec2<P> lens_offset(P mx, P my, const FaceRay<P>& ray) {
    return {gs_fma(mx, ray.w, -ray.x), gs_fma(my, ray.w, -ray.y)};
}

/// Returns alpha of a splat at the ray of a pixel. A splat does not reach the other half of the sphere.
template <class T, class P>
GS_HD LensFragment<P> lens_fragment_alpha(const LensShape<P>& s, P opacity, FaceRay<P> ray) {
    // The shape relative to (0, 0), so that the offset is not rounded with the mean.
    const Vec2<P> d = lens_offset(s.mx, s.my, ray);
    FragmentAlpha<P> f = fragment_alpha(FragmentShape<P>{d.x, d.y, s.qa, s.qb, s.qc, opacity}, P(T(0)), P(T(0)));
    if (s.wide) {
        const P forward = gs_fma(s.forward.x, ray.x, gs_fma(s.forward.y, ray.y, s.forward.z * ray.w));
        f.alpha = select(at_least(forward, P(T(1e-3))), f.alpha, P(T(0)));
    }
    return {f, ray.w};
}

/// The front-to-back state of a pixel.
template <class P> struct PixelForward {
    P t, r, g, b;  ///< transmittance and colour so far
};

/// Returns whether a fragment counts: alpha and the pixel's transmittance before it are at the cutoffs (1/255, 1e-4) or
/// above.
template <class P, class T> GS_HD auto is_blended(P alpha, P transmittance, const Cutoffs<T>& cutoffs) {
    return at_least(alpha, P(cutoffs.alpha)) & at_least(transmittance, P(cutoffs.transmittance));
}

/// Adds the light of one fragment to the pixel, and reduces the transmittance; w = T alpha.
template <class P> GS_HD void pass_light(PixelForward<P>& s, P w, P cr, P cg, P cb) {
    s.r = gs_fma(w, cr, s.r);
    s.g = gs_fma(w, cg, s.g);
    s.b = gs_fma(w, cb, s.b);
    s.t = s.t - w;
}

/// Blends one fragment if it counts.
template <class P, class T>
GS_HD void blend_fragment(PixelForward<P>& s, P alpha, P cr, P cg, P cb, const Cutoffs<T>& cutoffs = {}) {
    pass_light(s, select(is_blended(alpha, s.t, cutoffs), s.t * alpha, P(T(0))), cr, cg, cb);
}

/// Transmittance at a pixel's median: half of its light comes from the median or from behind it.
inline constexpr double kMedianTransmittance = 0.5;

/// Passes one fragment as blend_fragment does. Sets the colour to the fragment's if the pixel's transmittance falls to
/// 1/2 or below there (docs/math/rasterizer.md#median). The colour is initially 0.
template <class P, class T>
GS_HD void pass_median(PixelForward<P>& s, P alpha, P cr, P cg, P cb, const Cutoffs<T>& cutoffs = {}) {
    const P half = P(T(kMedianTransmittance));
    PixelForward<P> blended = s;
    blend_fragment<P, T>(blended, alpha, cr, cg, cb, cutoffs);
    const auto falls = at_least(half, blended.t), fell = at_least(half, s.t);
    s.r = select(fell, s.r, select(falls, cr, s.r));
    s.g = select(fell, s.g, select(falls, cg, s.g));
    s.b = select(fell, s.b, select(falls, cb, s.b));
    s.t = blended.t;
}

/// The front-to-back state of a pixel in the backward pass. `behind` is dL/dpixel . (light not yet passed), so one
/// scalar replaces three; `background`, its part from the background, is T_final dL/dpixel . bg.
template <class P> struct PixelBackward {
    P t, behind;
    P gr, gg, gb;  ///< dL/dpixel
    P background;
};

/// The factors of one fragment's gradients: w = T alpha for the colour, h = -alpha dL/dalpha for the shape.
template <class P> struct FragmentGradient { P w, h; };

/// A fragment after blending. All fields except `inverse` are 0 if it was not blended.
template <class P> struct PassedFragment {
    P alpha;
    P w;        ///< T alpha
    P color;    ///< w dL/dpixel . colour
    P inverse;  ///< 1 / (1 - alpha)
};

/// Returns 1 / (1 - alpha), with the lower bound of the backward pass.
template <class P, class T> GS_HD P inverse_passed(P alpha) {
    return reciprocal(lane_max(P(T(1)) - alpha, P(T(kMinOneMinusAlpha))));
}

/// Passes one fragment from front to back. `t`, `behind` and `background` are fields of PixelBackward; color_gradient
/// is dL/dpixel . colour of the fragment.
template <class P, class T>
GS_HD PassedFragment<P> pass_fragment(P& t, P& behind, P background, P alpha, P color_gradient,
                                      const Cutoffs<T>& cutoffs) {
    alpha = select(is_blended(alpha, t, cutoffs), alpha, P(T(0)));
    const P w = t * alpha, color = w * color_gradient;
    t = t - w;
    // Only the background lies behind the fragment that finishes a pixel. Setting `behind` to it removes the one badly
    // conditioned case: rounding noise times 1/(1-alpha), which is up to 1e6.
    behind = select(at_least(t, P(cutoffs.transmittance)), behind - color, background);
    return {alpha, w, color, inverse_passed<P, T>(alpha)};
}

/// Returns the factor h of a passed fragment; `behind` is dL/dpixel . (light from behind the fragment).
template <class P> GS_HD P shape_factor(const PassedFragment<P>& f, P behind) {
    return gs_fma(f.alpha * f.inverse, behind, -f.color);
}

/// Returns dL/dpixel . colour of a fragment.
template <class P> GS_HD P color_gradient(const PixelBackward<P>& s, P cr, P cg, P cb) {
    return gs_fma(cr, s.gr, gs_fma(cg, s.gg, cb * s.gb));
}

template <class P, class T>
GS_HD FragmentGradient<P> fragment_gradient(PixelBackward<P>& s, P alpha, P color_gradient,
                                            const Cutoffs<T>& cutoffs = {}) {
    const PassedFragment<P> f = pass_fragment<P, T>(s.t, s.behind, s.background, alpha, color_gradient, cutoffs);
    return {f.w, shape_factor(f, s.behind)};
}

/// The front-to-back state of a pixel while its fragments are scored. It is the state of PixelBackward for L = I, the
/// sum of the channels of the composited colour.
template <class P> struct PixelScore {
    P t, behind, background;

    /// Returns the initial state of a pixel with this colour and final transmittance.
    template <class T> static GS_HD PixelScore of(const Vec3<T>& color, T transmittance, const Vec3<T>& bg) {
        const T background = transmittance * (bg.x + bg.y + bg.z);
        return {P(T(1)), P(color.x + color.y + color.z), P(background)};
    }
};

/// Returns (dI/dG)^2 of one fragment, where G = alpha / opacity is the Gaussian's value
/// (docs/math/densification.md#pruning-by-score). A value that is not finite counts as 0, like a Gaussian that was
/// never seen.
template <class P, class T>
GS_HD P fragment_score(PixelScore<P>& s, P alpha, P opacity, P color_sum, const Cutoffs<T>& cutoffs) {
    const P t = s.t;
    const PassedFragment<P> f = pass_fragment<P, T>(s.t, s.behind, s.background, alpha, color_sum, cutoffs);
    const P slope = opacity * (t * color_sum - s.behind * f.inverse), square = slope * slope;
    const auto blended = at_least(f.alpha, P(cutoffs.alpha));
    return select(at_least(P(T(kLargestScore)), square) & blended, square, P(T(0)));
}

/// Adds one fragment to the sums of its splat. Fragment is FragmentAlpha or LensFragment.
template <class P, class T, class Fragment>
GS_HD void blend_fragment_backward(PixelBackward<P>& s, const Fragment& f, P cr, P cg, P cb, const Cutoffs<T>& cutoffs,
                                   SplatSums<P>& sum) {
    const FragmentGradient<P> d = fragment_gradient<P, T>(s, f.alpha, color_gradient(s, cr, cg, cb), cutoffs);
    const P hx = d.h * f.dx, hy = d.h * f.dy;
    sum.h = sum.h + d.h;
    if constexpr (requires { f.w; }) {
        sum.hx = gs_fma(hx, f.w, sum.hx);
        sum.hy = gs_fma(hy, f.w, sum.hy);
    } else {
        sum.hx = sum.hx + hx;
        sum.hy = sum.hy + hy;
    }
    sum.hxx = gs_fma(hx, f.dx, sum.hxx);
    sum.hxy = gs_fma(hx, f.dy, sum.hxy);
    sum.hyy = gs_fma(hy, f.dy, sum.hyy);
    sum.r = gs_fma(d.w, s.gr, sum.r);
    sum.g = gs_fma(d.w, s.gg, sum.g);
    sum.b = gs_fma(d.w, s.gb, sum.b);
}

}  // namespace gs
