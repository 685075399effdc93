// SPDX-License-Identifier: Apache-2.0
// NASG: normalized anisotropic spherical Gaussian lobes. NASGabor adds a cosine carrier.
#pragma once

#include "appearance/contract.h"
#include "kernels/base/vec.h"

namespace gs::appearance {

// One normalized anisotropic spherical Gaussian: its frame (docs/math/appearance.md#lobe-frame), its density and the
// derivatives (docs/math/appearance.md#lobe-density, #lobe-gradients). The density is written with ln K, where
// K = (1 + v_z)/2.

/// The largest raw angle. It keeps |tanh| of the parameter below 0.999999 = tanh(7.254...), so that every angle is in
/// (0, pi) and its sine is at least 1.4e-3.
inline constexpr double kLargestRawAngle = 7.254328619247669;
/// The largest raw sharpness or anisotropy, ln 1e4. Sharpness and anisotropy stay below 1e4, beyond which a lobe is
/// narrower than any pixel.
inline constexpr double kLargestRawShape = 9.210340371976184;
/// The smallest raw sharpness, ln 1e-6. Below this sharpness the density is uniform in float precision; at sharpness 0
/// its terms would be 0/0.
inline constexpr double kSmallestRawSharpness = -13.815510557964274;
/// A constant that the reference implementation adds to the exponent of K.
inline constexpr double kExponentFloor = 5e-6;
/// The smallest squared sine of the angle to the axis. The sine, 1e-7, is about the resolution of a direction in float.
inline constexpr double kSmallestSine2 = 1e-14;
/// The squared sine of the angle (4.9e-4 radians) around the antipode within which the unbounded terms of the gradient
/// are left out, as in the reference. The density has no limit at the antipode, since it depends on the azimuth.
inline constexpr double kAntipodeSine2 = 2.4e-7;

/// An angle whose cosine is tanh(raw), kept away from 0 and pi.
template <class T> struct LobeAngle {
    T cos, sin;

    static GS_HD LobeAngle of(T raw) {
        const T r = at_least(at_most(raw, T(kLargestRawAngle)), T(-kLargestRawAngle));
        const T e = gs_exp(-gs_abs(r)), inverse = T(1) / (T(1) + e * e);
        const T c = (T(1) - e * e) * inverse;
        return {r < T(0) ? -c : c, T(2) * e * inverse};
    }
    /// Returns dL/draw from dL/dangle; d angle/d raw = -sin.
    GS_HD T raw_gradient(T raw, T dL_dangle) const {
        const T g = -sin * dL_dangle;
        return gradient_at_least(gradient_at_most(g, raw, T(kLargestRawAngle)), raw, T(-kLargestRawAngle));
    }
};

/// The orthonormal frame R_z(theta) R_y(phi) R_z(psi); z is the lobe's axis, x the direction of its faster decay. phi
/// and psi are in (0, pi). theta is in (0, pi) in the reference, whose axes then all lie in the half-space y > 0. With
/// kWholeSphere it is in (-pi/2, 3 pi/2), which includes the opposite half-space.
template <class T, bool kWholeSphere> struct LobeFrame {
    LobeAngle<T> theta, phi, psi;
    Vec3<T> x, y, z;

    static GS_HD LobeFrame of(const T* raw) {
        LobeFrame f;
        f.theta = LobeAngle<T>::of(raw[0]), f.phi = LobeAngle<T>::of(raw[1]), f.psi = LobeAngle<T>::of(raw[2]);
        if (kWholeSphere) {  // theta becomes 2 theta - pi/2, which leaves it unchanged at raw 0
            const T c = f.theta.cos, s = f.theta.sin;
            f.theta.cos = T(2) * s * c, f.theta.sin = (s - c) * (s + c);
        }
        const T ct = f.theta.cos, st = f.theta.sin, cp = f.phi.cos, sp = f.phi.sin, cs = f.psi.cos, ss = f.psi.sin;
        f.x = {ct * cp * cs - st * ss, st * cp * cs + ct * ss, -sp * cs};
        f.y = {-ct * cp * ss - st * cs, -st * cp * ss + ct * cs, sp * ss};
        f.z = {ct * sp, st * sp, cp};
        return f;
    }
    GS_HD Vec3<T> local(const Vec3<T>& d) const { return {dot(x, d), dot(y, d), dot(z, d)}; }
    GS_HD Vec3<T> world(const Vec3<T>& v) const { return x * v.x + y * v.y + z * v.z; }

    /// Computes the gradient of the three raw angles from the gradient `g` of the local direction `v`. A rotation of
    /// the frame about an axis e changes L by e . (g x v), which avoids divisions by a sine. The rotation axes are
    /// world z, (-sin theta, cos theta, 0) and the lobe's axis.
    GS_HD void raw_gradient(const T* raw, const Vec3<T>& g, const Vec3<T>& v, T* dL_draw) const {
        const Vec3<T> local_torque = cross(g, v), torque = world(local_torque);
        dL_draw[0] = LobeAngle<T>::of(raw[0]).raw_gradient(raw[0], kWholeSphere ? T(2) * torque.z : torque.z);
        dL_draw[1] = phi.raw_gradient(raw[1], theta.cos * torque.y - theta.sin * torque.x);
        dL_draw[2] = psi.raw_gradient(raw[2], local_torque.z);
    }
};

/// The density B = N K^kappa exp(2 lambda (K^(1+kappa) - 1)) in local direction v, and the terms shared by its
/// derivatives.
template <class T> struct LobeDensity {
    T t, a;   ///< 2 lambda, anisotropy
    T s2, q;  ///< squared sine of the angle to the axis; squared cosine of the azimuth
    T log_k, kappa;
    T decay;  ///< K^(1+kappa) - 1, without cancellation
    T value;

    static GS_HD LobeDensity of(const Vec3<T>& v, T raw_sharpness, T raw_anisotropy) {
        const T t = twice_sharpness(raw_sharpness), a = anisotropy(raw_anisotropy);
        return of_shape(v, t, a, norm(t, a));
    }
    static GS_HD T twice_sharpness(T raw) {
        return T(2) * gs_exp(at_least(at_most(raw, T(kLargestRawShape)), T(kSmallestRawSharpness)));
    }
    static GS_HD T anisotropy(T raw) { return gs_exp(at_most(raw, T(kLargestRawShape))); }
    /// Returns N, the density at the axis.
    static GS_HD T norm(T t, T a) {
        return gs_sqrt(T(1) + a) * T(0.07957747154594767) * t / -gs_expm1(-t);
    }  // 1/(4 pi)

    static GS_HD LobeDensity of_shape(const Vec3<T>& v, T t, T a, T norm) {
        LobeDensity b;
        b.t = t;
        b.a = a;
        b.s2 = at_least(v.x * v.x + v.y * v.y, T(kSmallestSine2));
        b.q = v.x * v.x / b.s2;
        // ln K comes from the sine, because 1 + v_z cancels on one side of the sphere and 1 - v_z on the other.
        b.log_k = v.z >= T(0) ? gs_log1p(-b.s2 / (T(2) * (T(1) + v.z))) : gs_log(b.s2 / (T(2) * (T(1) - v.z)));
        b.kappa = T(kExponentFloor) + b.a * b.q;
        b.decay = gs_expm1((T(1) + b.kappa) * b.log_k);
        b.value = norm * gs_exp(b.kappa * b.log_k + b.t * b.decay);
        return b;
    }

    /// Returns d ln B / d kappa.
    GS_HD T slope_kappa() const { return log_k * (T(1) + t * (T(1) + decay)); }
    /// Returns d ln B / d ln lambda, valid at the limits of lambda too.
    GS_HD T slope_sharpness() const { return t * decay + norm_slope(t); }
    /// Returns dL/d raw sharpness from dL/d ln lambda; zero at a limit if the optimizer would move further beyond it.
    static GS_HD T sharpness_gradient(T raw, T gradient) {
        return gradient_at_least(gradient_at_most(gradient, raw, T(kLargestRawShape)), raw, T(kSmallestRawSharpness));
    }
    /// Returns d ln N / d ln lambda = 1 - t/(e^t - 1). Small t, where this formula cancels, uses the series t/2 - sum
    /// B_2k t^2k / (2k)!, which is exact to the last digit in double.
    static GS_HD T norm_slope(T t) {
        if (!(t < T(0.25))) return T(1) - t / gs_expm1(t);
        const T x = t * t;
        return t * (T(0.5) - t * (T(1. / 12) - x * (T(1. / 720) - x * (T(1. / 30240) -
                                                                       x * (T(1. / 1209600) - x * T(1. / 47900160))))));
    }
    /// Returns d ln B / d ln a.
    GS_HD T slope_anisotropy() const { return a * (q * slope_kappa() + T(0.5) / (T(1) + a)); }
    /// Returns d ln B / d v. The density is extended off the sphere, so only the tangential part of the result is
    /// meaningful. 1 - v_z^2 is computed as v_x^2 + v_y^2, which keeps every term as small as their sum.
    GS_HD Vec3<T> slope_direction(const Vec3<T>& v) const {
        const bool cut = v.z < T(0) && s2 < T(kAntipodeSine2);
        const T turn = cut ? T(0) : T(2) * a * (slope_kappa() / s2) * v.x * v.y / s2;
        const T pull = cut ? T(0) : kappa * gs_exp(-log_k);
        return {turn * v.y, -turn * v.x, T(0.5) * (pull + t * (T(1) + kappa) * gs_exp(kappa * log_k))};
    }
};

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
    /// Returns the derivative with respect to k v_x.
    GS_HD T slope() const { return -cos * sin; }
};

/// residual(d) = sum over the active lobes of density(d) carrier(d) tanh(raw amplitude).
/// Parameters of one lobe: raw theta, phi, psi, sharpness, anisotropy, raw frequency (only with a carrier), raw
/// amplitude (rgb). With kWholeSphere axes may point anywhere, otherwise only into the half-space y > 0, as in the
/// reference.
template <bool kWithCarrier, int kLobes = 1, bool kWholeSphere = true> struct NasgLobes {
    static constexpr int kPerLobe = kWithCarrier ? 9 : 8, kAmplitude = kPerLobe - 3;
    static constexpr int kMaxResidual = kLobes * kPerLobe;
    static constexpr bool kDirectional = true;

    template <class T> using Frame = LobeFrame<T, kWholeSphere>;
    // With kWholeSphere the circle traced by theta lies in the y-z plane, which contains the up direction of every
    // convention. The poles of the angles, where training is poor, are then at the sides (+-x).
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
                dot(amplitude(raw), dL_dresidual) * density.value;  // times the carrier it is dL/d ln density
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
