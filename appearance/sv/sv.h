// SPDX-License-Identifier: Apache-2.0
// SV: spherical Voronoi. Colours at sites on the sphere, blended by a softmax over the distance to each.
#pragma once

#include "appearance/clamps.h"
#include "appearance/contract.h"

namespace gs::appearance {

/// Temperatures stay below e^11 = 6e4: cells are then harder than a pixel can tell, and float's weights still exact enough.
inline constexpr double kLargestRawTemperature = 11;
/// Shortest raw site, whose direction (only that matters) still has a gradient.
inline constexpr double kShortestSite = 1e-6;

/// residual(d) = sum_i w_i c_i, w = softmax(-tau_i |s_i - d|) over the first `degree` sites.
/// Rows of one site: raw site (3, normalised to s), raw temperature (tau = e^raw), colour (rgb).
template <int kSites> struct SphericalVoronoi {
    static constexpr int kPerSite = 7;
    static constexpr int kMaxResidual = kSites * kPerSite;
    static constexpr bool kDirectional = true;

    /// One site as seen from one direction.
    template <class T> struct Site {
        Vec3<T> unit, offset; ///< s; s - d
        T length, distance;   ///< of the raw site; |s - d|, by the difference: 2 - 2 s.d would cancel
        T temperature, logit;

        static GS_HD Site of(const T* raw, const Vec3<T>& d) {
            Site site;
            const Vec3<T> r{raw[0], raw[1], raw[2]};
            site.length = at_least(gs_sqrt(dot(r, r)), T(1e-12));
            site.unit = r * (T(1) / site.length);
            site.offset = site.unit - d;
            site.distance = gs_sqrt(dot(site.offset, site.offset));
            site.temperature = gs_exp(at_most(raw[3], T(kLargestRawTemperature)));
            site.logit = -site.temperature * site.distance;
            return site;
        }
    };

    /// The softmax so far: largest logit, sum of weights relative to it, weighted sum of colours.
    template <class T> struct Blend {
        T largest, weight;
        Vec3<T> color;

        static GS_HD Blend of(const T* params, const Vec3<T>& d, int degree) {
            Blend b{T(-1e30), T(0), {T(0), T(0), T(0)}};
            GS_UNROLL
            for (int i = 0; i < kSites; ++i) {
                if (i >= degree) break;
                const T* raw = params + i * kPerSite;
                const T logit = Site<T>::of(raw, d).logit;
                const T largest = gs_max(logit, b.largest), keep = gs_exp(b.largest - largest), add = relative(logit, largest);
                b.weight = b.weight * keep + add;
                b.color = b.color * keep + Vec3<T>{raw[4], raw[5], raw[6]} * add;
                b.largest = largest;
            }
            return b;
        }
        /// exp(logit - largest). Fused multiply-add may leave the logit's product a rounding above its own maximum, hence the
        /// minimum; written so that NaN stays NaN.
        static GS_HD T relative(T logit, T largest) { return gs_exp(at_most(logit - largest, T(0))); }
    };

    template <class T> static GS_HD Vec3<T> residual(const T* params, const Vec3<T>& direction, int degree) {
        if (degree <= 0) return {T(0), T(0), T(0)};
        const Blend<T> b = Blend<T>::of(params, direction, degree);
        return b.color * (T(1) / b.weight);
    }

    template <class T>
    static GS_HD void residual_backward(const T* params, const Vec3<T>& direction, int degree, const Vec3<T>& dL_dresidual, T* dL_dparams,
                                        Vec3<T>& dL_ddirection) {
        dL_ddirection = {T(0), T(0), T(0)};
        if (degree <= 0) return;
        const Blend<T> b = Blend<T>::of(params, direction, degree);
        const T inverse = T(1) / b.weight, mean = dot(b.color, dL_dresidual) * inverse;
        GS_UNROLL
        for (int i = 0; i < kSites; ++i) {
            if (i >= degree) break;
            const T* raw = params + i * kPerSite;
            T* out = dL_dparams + i * kPerSite;
            const Site<T> site = Site<T>::of(raw, direction);
            const T w = Blend<T>::relative(site.logit, b.largest) * inverse;
            const T dL_dlogit = w * (raw[4] * dL_dresidual.x + raw[5] * dL_dresidual.y + raw[6] * dL_dresidual.z - mean);
            // At the site itself the distance has a kink: its subgradient 0.
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
