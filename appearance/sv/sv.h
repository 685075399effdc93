// SPDX-License-Identifier: Apache-2.0
// SV: spherical Voronoi, colours at sites on the sphere, blended by a softmax over the distances to the sites.
#pragma once

#include "appearance/contract.h"

namespace gs::appearance {

/// The largest raw temperature, which keeps temperatures below e^11 = 6e4. At this limit cell borders are sharper than
/// a pixel, and weights in float are still accurate enough.
inline constexpr double kLargestRawTemperature = 11;
/// The length below which a raw site gets no gradient. Only the direction of a site matters.
inline constexpr double kShortestSite = 1e-6;

/// residual(d) = sum_i w_i c_i, w = softmax(-tau_i |s_i - d|) over the first `degree` sites.
/// Parameters of one site: raw site (3, normalised to s), raw temperature (tau = e^raw), colour (rgb).
template <int kSites> struct SphericalVoronoi {
    static constexpr int kPerSite = 7;
    static constexpr int kMaxResidual = kSites * kPerSite;
    static constexpr bool kDirectional = true;

    /// One site seen from one direction d.
    template <class T> struct Site {
        Vec3<T> unit, offset;  ///< the unit site s; s - d
        T length, distance;    ///< length of the raw site; |s - d| (2 - 2 s.d would cancel)
        T temperature, logit;

        static GS_HD Site of(const T* raw, const Vec3<T>& d) {
            Site site;
            Vec3<T> r{raw[0], raw[1], raw[2]};
            T norm2 = dot(r, r), shrink = T(1);
            if (norm2 > T(1e30)) {  // float's squares would overflow and put the site at the origin
                shrink = T(1e-20);
                r = r * shrink;
                norm2 = dot(r, r);
            }
            const T length = at_least(gs_sqrt(norm2), T(1e-12));
            site.unit = r * (T(1) / length);
            site.length = length / shrink;
            site.offset = site.unit - d;
            site.distance = gs_sqrt(dot(site.offset, site.offset));
            site.temperature = gs_exp(at_most(raw[3], T(kLargestRawTemperature)));
            site.logit = -site.temperature * site.distance;
            return site;
        }
    };

    /// Running softmax: the largest logit so far, and the sum of the weights relative to it.
    template <class T> struct Softmax {
        T largest = T(-1e30), sum = T(0);

        /// The change of the running sums by a new logit.
        struct Change {
            bool likelier;  ///< true: `factor` multiplies the sums so far; false: it multiplies the new term
            T factor;
        };
        /// Adds a logit with one exponential. The argument of the exponential is never positive: with fused
        /// multiply-add a recomputed logit may exceed its own maximum by a rounding error. NaN stays NaN.
        GS_HD Change add(T logit) {
            const Change c{logit > largest, gs_exp(-gs_abs(logit - largest))};
            sum = c.likelier ? sum * c.factor + T(1) : sum + c.factor;
            largest = c.likelier ? logit : largest;
            return c;
        }
        /// Returns the weight of a logit before the division by the sum.
        GS_HD T relative(T logit) const { return gs_exp(at_most(logit - largest, T(0))); }
    };

    template <class T> static GS_HD Vec3<T> site_color(const T* raw) { return {raw[4], raw[5], raw[6]}; }

    template <class T> static GS_HD Vec3<T> residual(const T* params, const Vec3<T>& direction, int degree) {
        if (degree <= 0) return {T(0), T(0), T(0)};
        Softmax<T> softmax;
        Vec3<T> color{T(0), T(0), T(0)};
        GS_UNROLL
        for (int i = 0; i < kSites; ++i) {
            if (i >= degree) break;
            const T* raw = params + i * kPerSite;
            const auto [likelier, factor] = softmax.add(Site<T>::of(raw, direction).logit);
            color = likelier ? color * factor + site_color(raw) : color + site_color(raw) * factor;
        }
        return color * (T(1) / softmax.sum);
    }

    /// The softmax, the colour of its likeliest site (`origin`), and the amount by which the mean colour exceeds it
    /// along dL_dresidual, times the sum of weights (`excess`). Differences from the mean colour drive the gradients of
    /// sites and temperatures. If one site has all the weight, or if all colours are equal, differences of absolute
    /// colours would be pure rounding errors, which Adam would turn into full steps.
    template <class T> struct MeanExcess {
        Softmax<T> softmax;
        Vec3<T> origin{T(0), T(0), T(0)};
        T excess = T(0);

        static GS_HD MeanExcess of(const T* params, const Vec3<T>& d, int degree, const Vec3<T>& dL_dresidual) {
            MeanExcess m;
            GS_UNROLL
            for (int i = 0; i < kSites; ++i) {
                if (i >= degree) break;
                const T* raw = params + i * kPerSite;
                const T sum_before = m.softmax.sum, step = dot(site_color(raw) - m.origin, dL_dresidual);
                const auto [likelier, factor] = m.softmax.add(Site<T>::of(raw, d).logit);
                m.excess = likelier ? (m.excess - step * sum_before) * factor : m.excess + step * factor;
                if (likelier) m.origin = site_color(raw);
            }
            return m;
        }
    };

    template <class T>
    static GS_HD void residual_backward(const T* params, const Vec3<T>& direction, int degree,
                                        const Vec3<T>& dL_dresidual, T* dL_dparams, Vec3<T>& dL_ddirection) {
        dL_ddirection = {T(0), T(0), T(0)};
        if (degree <= 0) return;
        const MeanExcess<T> all = MeanExcess<T>::of(params, direction, degree, dL_dresidual);
        const T inverse = T(1) / all.softmax.sum, mean = all.excess * inverse;
        GS_UNROLL
        for (int i = 0; i < kSites; ++i) {
            if (i >= degree) break;
            const T* raw = params + i * kPerSite;
            T* out = dL_dparams + i * kPerSite;
            const Site<T> site = Site<T>::of(raw, direction);
            const T w = all.softmax.relative(site.logit) * inverse;
            const T dL_dlogit = w * (dot(site_color(raw) - all.origin, dL_dresidual) - mean);
            // The distance has a kink at the site itself; the subgradient 0 is used there.
            const Vec3<T> dL_dsite = site.offset * (-site.temperature * dL_dlogit / at_least(site.distance, T(1e-12)));
            if (site.length >= T(kShortestSite)) {
                const Vec3<T> g = (dL_dsite - site.unit * dot(dL_dsite, site.unit)) * (T(1) / site.length);
                out[0] = g.x, out[1] = g.y, out[2] = g.z;
            }
            out[3] = gradient_at_most(site.logit * dL_dlogit, raw[3], T(kLargestRawTemperature));
            out[4] = w * dL_dresidual.x, out[5] = w * dL_dresidual.y, out[6] = w * dL_dresidual.z;
            dL_ddirection = dL_ddirection - dL_dsite;
        }
    }
};

using Sv = SphericalVoronoi<7>;

}  // namespace gs::appearance
