// SPDX-License-Identifier: Apache-2.0
// NASG: normalized anisotropic spherical Gaussian lobes. NASGabor adds a cosine carrier.
#pragma once

#include "appearance/contract.h"
#include "appearance/nasg/lobe.h"

namespace gs::appearance {

/// Half the largest angular frequency of the carrier.
inline constexpr double kCarrierScale = 20;

/// The carrier (1 + cos(k v_x))/2 with k = 20 (1 + tanh(raw)). It is computed as cos^2 of half the phase, because the
/// sum would cancel at its zeros.
template <class T> struct Carrier {
    T frequency, cos, sin;  ///< k; cosine and sine of k v_x / 2
    static GS_HD Carrier of(T raw, T v_x) {
        const T k = T(2 * kCarrierScale) * sigmoid(T(2) * raw);  // 1 + tanh(x) = 2 sigmoid(2x), without cancellation
        const T half = T(0.5) * k * v_x;
        return {k, gs_cos(half), gs_sin(half)};
    }
    GS_HD T value() const { return cos * cos; }
    /// Returns the derivative by k v_x.
    GS_HD T slope() const { return -cos * sin; }
};

/// residual(d) = sum over the active lobes of density(d) carrier(d) tanh(raw amplitude).
/// Parameters of one lobe: raw theta, phi, psi, sharpness, anisotropy, raw frequency (only with a carrier), raw
/// amplitude (rgb). Axes may point anywhere with kWholeSphere, else into the half-space y >= 0, as in the reference.
template <bool kWithCarrier, int kLobes = 1, bool kWholeSphere = true> struct NasgLobes {
    static constexpr int kPerLobe = kWithCarrier ? 9 : 8, kAmplitude = kPerLobe - 3;
    static constexpr int kMaxResidual = kLobes * kPerLobe;
    static constexpr bool kDirectional = true;

    template <class T> using Frame = LobeFrame<T, kWholeSphere>;
    // With kWholeSphere the circle that theta runs along lies in the plane of y and z, where every convention has its
    // up. The poles of the angles, where they learn badly, are then off to the sides.
    template <class T> static GS_HD Vec3<T> to_lobe(const Vec3<T>& d) {
        return kWholeSphere ? Vec3<T>{d.z, d.y, -d.x} : d;
    }
    template <class T> static GS_HD Vec3<T> from_lobe(const Vec3<T>& v) {
        return kWholeSphere ? Vec3<T>{-v.z, v.y, v.x} : v;
    }

    template <class T> static GS_HD Vec3<T> amplitude(const T* raw) {
        return {gs_tanh(raw[kAmplitude]), gs_tanh(raw[kAmplitude + 1]), gs_tanh(raw[kAmplitude + 2])};
    }

    template <class T> static GS_HD Vec3<T> residual(const T* params, const Vec3<T>& direction, int degree) {
        Vec3<T> sum{T(0), T(0), T(0)};
        GS_UNROLL
        for (int lobe = 0; lobe < kLobes; ++lobe) {
            if (lobe >= degree) break;
            const T* raw = params + lobe * kPerLobe;
            const Vec3<T> v = Frame<T>::of(raw).local(to_lobe(direction));
            T value = LobeDensity<T>::of(v, raw[3], raw[4]).value;
            if constexpr (kWithCarrier) value = value * Carrier<T>::of(raw[5], v.x).value();
            sum += amplitude(raw) * value;
        }
        return sum;
    }

    template <class T>
    static GS_HD void residual_backward(const T* params, const Vec3<T>& direction, int degree,
                                        const Vec3<T>& dL_dresidual, T* dL_dparams, Vec3<T>& dL_ddirection) {
        dL_ddirection = {T(0), T(0), T(0)};
        GS_UNROLL
        for (int lobe = 0; lobe < kLobes; ++lobe) {
            if (lobe >= degree) break;
            const T* raw = params + lobe * kPerLobe;
            T* out = dL_dparams + lobe * kPerLobe;
            const Frame<T> frame = Frame<T>::of(raw);
            const Vec3<T> v = frame.local(to_lobe(direction));
            const LobeDensity<T> density = LobeDensity<T>::of(v, raw[3], raw[4]);
            const T g_density =
                dot(amplitude(raw), dL_dresidual) * density.value;  // times the carrier: dL/d ln density
            T carrier = T(1), dL_dphase_x = T(0);
            if constexpr (kWithCarrier) {
                const Carrier<T> c = Carrier<T>::of(raw[5], v.x);
                carrier = c.value();
                const T g_phase = g_density * c.slope();
                dL_dphase_x = g_phase * c.frequency;
                out[5] = g_phase * v.x * T(kCarrierScale) * tanh_derivative(raw[5]);
            }
            const T g = g_density * carrier, value = density.value * carrier;
            out[3] = LobeDensity<T>::sharpness_gradient(raw[3], g * density.slope_sharpness());
            out[4] = gradient_at_most(g * density.slope_anisotropy(), raw[4], T(kLargestRawShape));
            out[kAmplitude] = value * dL_dresidual.x * tanh_derivative(raw[kAmplitude]);
            out[kAmplitude + 1] = value * dL_dresidual.y * tanh_derivative(raw[kAmplitude + 1]);
            out[kAmplitude + 2] = value * dL_dresidual.z * tanh_derivative(raw[kAmplitude + 2]);
            Vec3<T> g_local = density.slope_direction(v) * g;
            g_local.x = g_local.x + dL_dphase_x;
            frame.raw_gradient(raw, g_local, v, out);
            dL_ddirection += from_lobe(frame.world(g_local));
        }
    }
};

using Nasg = NasgLobes<false>;
using Nasgabor = NasgLobes<true>;

}  // namespace gs::appearance
