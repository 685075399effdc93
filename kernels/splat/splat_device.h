// SPDX-License-Identifier: Apache-2.0
// A splat, which is a Gaussian on screen in the form for blending, and the gradients that blending returns.
#pragma once

#include "kernels/base/lanes.h"
#include "kernels/base/vec.h"
#include "kernels/splat/lens_device.h"
#include "kernels/splat/raster_config.h"

namespace gs {

/// A Gaussian on screen in the form for blending.
template <class T> struct Splat {
    Vec2<T> mean;   ///< pixels
    T a, b, c;      ///< conic: inverse of the dilated 2-D covariance [[a,b],[b,c]]
    T opacity;      ///< activated
    Vec3<T> color;  ///< after the colour activation
    T threshold;    ///< ln(opacity / cutoff) >= 0: the power at which alpha falls to the cutoff, 1/255
};

/// A splat with its conic scaled so that alpha = opacity * 2^(qa dx^2 + qb dx dy + qc dy^2).
template <class P> struct FragmentShape {
    P mx, my, qa, qb, qc, opacity;

    template <class T> static GS_HD FragmentShape from(const Splat<T>& s) {
        const T k = T(-0.5 * kLog2E);
        return {P(s.mean.x), P(s.mean.y), P(k * s.a), P(T(2) * k * s.b), P(k * s.c), P(s.opacity)};
    }
};

/// The shape of a splat through a lens, on its face (docs/math/rasterizer.md#lenses). Its offset from a FaceRay is w mx
/// - x and w my - y.
template <class P> struct LensShape {
    P mx, my, qa, qb, qc;  ///< as in FragmentShape, in pixels of the face
    Vec3<P> forward;       ///< its product with a FaceRay is positive if the ray is less than 90 degrees from the mean
    int axis;              ///< axis_of() the face
    bool wide;             ///< whether its outline comes near rays opposite to the mean, where alpha is as at the mean

    /// Returns a shape with this mean and the conic of a splat on its face. The rest depends on the outline.
    static GS_HD LensShape scaled(const Vec2<P>& mean, const Splat<P>& s) {
        const P k = P(-0.5 * kLog2E);
        return {mean.x, mean.y, k * s.a, P(2) * k * s.b, k * s.c, {}, 0, true};
    }
    /// Sets the conic of the splat from that of the shape.
    GS_HD void unscale(Splat<P>& s) const {
        const P k = P(-2 / kLog2E);
        s.a = k * qa, s.b = P(0.5) * k * qb, s.c = k * qc;
    }
    /// Returns face_of() the mean.
    GS_HD int face() const { return axis + (forward.z < P(0) ? kFaceAxes : 0); }
};

/// Returns the shape of a splat that is known not to be wide, so that the compiler knows it, too.
template <class P> GS_HD LensShape<P> narrow(LensShape<P> s) {
    s.wide = false;
    return s;
}

/// Returns the threshold of a splat with this opacity.
template <class Real> GS_HD Real splat_threshold(Real opacity, Real inverse_alpha) {
    return gs_max(gs_log(inverse_alpha * opacity), Real(0));
}

/// Returns the threshold of the touch tests. It is larger than the splat's own by more than the rounding error of the
/// power in float, and by too little to cost time.
template <class Real> GS_HD Real touch_threshold(const Splat<Real>& s) {
    return s.threshold * Real(1.0001) + Real(1e-3);
}

/// The gradients of the loss with respect to one splat.
template <class T> struct SplatGradient {
    Vec2<T> mean;   ///< pixels, of the face through a lens
    Sym2<T> conic;  ///< matrix gradient (half convention)
    T opacity;      ///< activated opacity
    Vec3<T> color;  ///< after the colour activation
};

/// The sums of one splat over its pixels, with h = -alpha dL/dalpha. r, g and b are sums of w dL/dpixel, where w is
/// alpha times the transmittance: with dL/dpixel = 1 they are the splat's blending weights. Through a lens the terms of
/// hx and hy are weighted by FaceRay::w, by which the offset changes with the mean.
template <class P> struct SplatSums {
    P h, hx, hy, hxx, hxy, hyy, r, g, b;

    GS_HD SplatSums operator*(P s) const {
        return {h * s, hx * s, hy * s, hxx * s, hxy * s, hyy * s, r * s, g * s, b * s};
    }
};

/// Returns the gradients of a splat from its sums over pixels.
template <class T> GS_HD SplatGradient<T> splat_gradient(const Splat<T>& s, const SplatSums<T>& k) {
    SplatGradient<T> d;
    d.mean = {s.a * k.hx + s.b * k.hy, s.b * k.hx + s.c * k.hy};
    d.conic = {T(0.5) * k.hxx, T(0.5) * k.hxy, T(0.5) * k.hyy};
    d.opacity = -k.h / s.opacity;  // dL/do = sum G dL/dalpha and alpha = o G; o >= 1/255, since alpha was
    d.color = {k.r, k.g, k.b};
    return d;
}

}  // namespace gs
