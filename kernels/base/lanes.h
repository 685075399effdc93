// SPDX-License-Identifier: Apache-2.0
// Vectors of sixteen lanes, for blending sixteen pixels at once on the CPU.
//
// `Lanes<T>` holds 16 values in compiler vectors of the machine's register size. With AVX-512, the few operations that
// compilers translate poorly (compare + select, exp2, reciprocal) use its instructions. Every operation has an overload
// for a plain scalar, so the same templates serve one pixel (tests, CUDA) and sixteen.
#pragma once

#include <cstdint>

#include "kernels/base/portable.h"

#if defined(__AVX__) && !defined(__CUDACC__)
#include <immintrin.h>
#if defined(__AVX512F__) && defined(__AVX512DQ__)
#define GS_AVX512 1
#endif
#endif

namespace gs {

// --- scalar forms -------------------------------------------------------------------------------------------------
GS_HD bool at_least(float a, float b) { return a >= b; }
GS_HD bool at_least(double a, double b) { return a >= b; }
template <class T> GS_HD T select(bool m, T a, T b) { return m ? a : b; }
GS_HD float exp2_nonpositive(float x) {
    x = x < 0 ? x : 0.0f;
#ifdef __CUDA_ARCH__  // one instruction, 2 ulp; results below 2^-126 are 0 and would be skipped anyway
    float y;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
    return y;
#else
    return ::exp2f(x);
#endif
}
GS_HD double exp2_nonpositive(double x) { return ::exp2(x < 0 ? x : 0.0); }
GS_HD float lane_max(float a, float b) { return a > b ? a : b; }
GS_HD double lane_max(double a, double b) { return a > b ? a : b; }
GS_HD float lane_min(float a, float b) { return a < b ? a : b; }
GS_HD double lane_min(double a, double b) { return a < b ? a : b; }
GS_HD float reciprocal(float x) {
#ifdef __CUDA_ARCH__  // one instruction, 1 ulp
    float y;
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
    return y;
#else
    return 1.0f / x;
#endif
}
GS_HD double reciprocal(double x) { return 1.0 / x; }

#ifndef __CUDACC__  // device code has no compiler vectors and needs none

inline constexpr int kLanes = 16;

/// Size in bytes of the machine's vector registers. Compilers keep larger vectors in memory, and compare them lane by
/// lane.
#if defined(GS_AVX512)
inline constexpr int kPartBytes = 64;
#elif defined(__AVX__)
inline constexpr int kPartBytes = 32;
#else
inline constexpr int kPartBytes = 16;
#endif

template <class T> struct LaneTypes;
template <> struct LaneTypes<float> {
    typedef float Part __attribute__((vector_size(kPartBytes)));
    typedef std::int32_t Bits __attribute__((vector_size(kPartBytes)));
};
template <> struct LaneTypes<double> {
    typedef double Part __attribute__((vector_size(kPartBytes)));
    typedef std::int64_t Bits __attribute__((vector_size(kPartBytes)));
};
template <class T> inline constexpr int kPartLanes = kPartBytes / int(sizeof(T));
template <class T> inline constexpr int kParts = kLanes / kPartLanes<T>;

template <class T> struct Lanes {
    using Part = typename LaneTypes<T>::Part;
    Part parts[kParts<T>];

    Lanes() = default;
    GS_HD explicit Lanes(T x) {
        for (Part& part : parts) part = x - Part{};
    }
    /// Returns the vector whose k-th part is fn(k).
    template <class Fn> static GS_HD Lanes of(Fn fn) {
        Lanes r;
        for (int k = 0; k < kParts<T>; ++k) r.parts[k] = fn(k);
        return r;
    }
    static GS_HD Lanes load(const T* p) {
        Lanes r;
        __builtin_memcpy(r.parts, p, sizeof r.parts);
        return r;
    }
    GS_HD void store(T* p) const { __builtin_memcpy(p, parts, sizeof parts); }
    GS_HD T operator[](int lane) const { return parts[lane / kPartLanes<T>][lane % kPartLanes<T>]; }
    GS_HD void set(int lane, T x) { parts[lane / kPartLanes<T>][lane % kPartLanes<T>] = x; }
    GS_HD Lanes operator+(const Lanes& o) const {
        return of([&](int k) { return parts[k] + o.parts[k]; });
    }
    GS_HD Lanes operator-(const Lanes& o) const {
        return of([&](int k) { return parts[k] - o.parts[k]; });
    }
    GS_HD Lanes operator*(const Lanes& o) const {
        return of([&](int k) { return parts[k] * o.parts[k]; });
    }
    GS_HD Lanes operator/(const Lanes& o) const {
        return of([&](int k) { return parts[k] / o.parts[k]; });
    }
    GS_HD Lanes operator-() const {
        return of([&](int k) { return -parts[k]; });
    }
};

// --- sixteen lanes ------------------------------------------------------------------------------------------------
// With AVX-512, float lanes have overloads of these below.
template <class T> GS_HD Lanes<T> gs_fma(const Lanes<T>& a, const Lanes<T>& b, const Lanes<T>& c) {
    return Lanes<T>::of([&](int k) { return a.parts[k] * b.parts[k] + c.parts[k]; });
}
template <class T> GS_HD Lanes<T> reciprocal(const Lanes<T>& x) {
    return Lanes<T>::of([&](int k) { return T(1) / x.parts[k]; });
}
template <class T> GS_HD Lanes<T> lane_max(const Lanes<T>& a, const Lanes<T>& b) {
    return Lanes<T>::of([&](int k) { return a.parts[k] > b.parts[k] ? a.parts[k] : b.parts[k]; });
}
template <class T> GS_HD Lanes<T> lane_min(const Lanes<T>& a, const Lanes<T>& b) {
    return Lanes<T>::of([&](int k) { return a.parts[k] < b.parts[k] ? a.parts[k] : b.parts[k]; });
}

#ifdef GS_AVX512

template <class T> struct LaneMask {
    std::uint16_t bits;
    GS_HD LaneMask operator&(LaneMask o) const { return {std::uint16_t(bits & o.bits)}; }
};
template <class T> GS_HD unsigned mask_bits(LaneMask<T> m) { return m.bits; }

// The maskz forms compile to the plain instructions. The plain intrinsics read an uninitialized operand inside GCC's
// header, about which GCC 12 warns (GCC bug 105593).
inline constexpr __mmask16 kAllLanes = 0xffff;

GS_HD __m512 vector_of(const Lanes<float>& x) { return (__m512)x.parts[0]; }
GS_HD Lanes<float> lanes_of(__m512 x) {
    return Lanes<float>::of([&](int) { return (Lanes<float>::Part)x; });
}

GS_HD LaneMask<float> at_least(const Lanes<float>& a, const Lanes<float>& b) {
    return {_mm512_cmp_ps_mask(vector_of(a), vector_of(b), _CMP_GE_OQ)};
}
GS_HD LaneMask<double> at_least(const Lanes<double>& a, const Lanes<double>& b) {
    const unsigned lo = _mm512_cmp_pd_mask((__m512d)a.parts[0], (__m512d)b.parts[0], _CMP_GE_OQ);
    const unsigned hi = _mm512_cmp_pd_mask((__m512d)a.parts[1], (__m512d)b.parts[1], _CMP_GE_OQ);
    return {std::uint16_t(lo | hi << 8)};
}
GS_HD Lanes<float> select(LaneMask<float> m, const Lanes<float>& a, const Lanes<float>& b) {
    return lanes_of(_mm512_mask_blend_ps(m.bits, vector_of(b), vector_of(a)));
}
GS_HD Lanes<double> select(LaneMask<double> m, const Lanes<double>& a, const Lanes<double>& b) {
    Lanes<double> r;
    for (int i = 0; i < kLanes; ++i) r.set(i, m.bits >> i & 1 ? a[i] : b[i]);
    return r;
}
GS_HD Lanes<float> gs_fma(const Lanes<float>& a, const Lanes<float>& b, const Lanes<float>& c) {
    return lanes_of(_mm512_fmadd_ps(vector_of(a), vector_of(b), vector_of(c)));
}
GS_HD Lanes<float> reciprocal(const Lanes<float>& x) {
    // One Newton step on the 14-bit estimate makes the relative error less than 2^-23.
    const __m512 r = _mm512_maskz_rcp14_ps(kAllLanes, vector_of(x));
    const __m512 e = _mm512_fnmadd_ps(vector_of(x), r, _mm512_set1_ps(1.0f));
    return lanes_of(_mm512_fmadd_ps(r, e, r));
}
GS_HD Lanes<float> lane_max(const Lanes<float>& a, const Lanes<float>& b) {
    return lanes_of(_mm512_maskz_max_ps(kAllLanes, vector_of(a), vector_of(b)));
}
GS_HD Lanes<float> lane_min(const Lanes<float>& a, const Lanes<float>& b) {
    return lanes_of(_mm512_maskz_min_ps(kAllLanes, vector_of(a), vector_of(b)));
}
GS_HD Lanes<float> round_lanes(const Lanes<float>& x) {
    return lanes_of(_mm512_maskz_roundscale_ps(kAllLanes, vector_of(x), _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC));
}
GS_HD Lanes<float> scale_by_power_of_two(const Lanes<float>& x, const Lanes<float>& n) {
    return lanes_of(_mm512_maskz_scalef_ps(kAllLanes, vector_of(x), vector_of(n)));
}
GS_HD float sum_lanes(const Lanes<float>& x) {
    const __m256 a = _mm256_add_ps(_mm512_maskz_extractf32x8_ps(0xff, vector_of(x), 0),
                                   _mm512_maskz_extractf32x8_ps(0xff, vector_of(x), 1));
    const __m128 b = _mm_add_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
    const __m128 c = _mm_add_ps(b, _mm_movehl_ps(b, b));
    return _mm_cvtss_f32(_mm_add_ss(c, _mm_movehdup_ps(c)));
}

#else

template <class T> struct LaneMask {
    typename LaneTypes<T>::Bits bits[kParts<T>];
    GS_HD LaneMask operator&(const LaneMask& o) const {
        LaneMask r;
        for (int k = 0; k < kParts<T>; ++k) r.bits[k] = bits[k] & o.bits[k];
        return r;
    }
};
template <class T> GS_HD unsigned mask_bits(const LaneMask<T>& m) {
    unsigned r = 0;
    for (int k = 0; k < kParts<T>; ++k) {
#ifdef __AVX__
        const unsigned part = sizeof(T) == 4 ? unsigned(_mm256_movemask_ps((__m256)m.bits[k]))
                                             : unsigned(_mm256_movemask_pd((__m256d)m.bits[k]));
#else
        unsigned part = 0;
        for (int i = 0; i < kPartLanes<T>; ++i) part |= unsigned(m.bits[k][i] & 1) << i;
#endif
        r |= part << (k * kPartLanes<T>);
    }
    return r;
}
template <class T> GS_HD LaneMask<T> at_least(const Lanes<T>& a, const Lanes<T>& b) {
    LaneMask<T> r;
    for (int k = 0; k < kParts<T>; ++k) r.bits[k] = a.parts[k] >= b.parts[k];
    return r;
}
template <class T> GS_HD Lanes<T> select(const LaneMask<T>& m, const Lanes<T>& a, const Lanes<T>& b) {
    return Lanes<T>::of([&](int k) { return m.bits[k] ? a.parts[k] : b.parts[k]; });
}
GS_HD Lanes<float> round_lanes(const Lanes<float>& x) {
    // Adding 1.5*2^23 pushes the fraction out of the mantissa. This is exact for |x| < 2^22, which exp2's clamp
    // ensures.
    const Lanes<float> magic(12582912.0f);
    return (x + magic) - magic;
}
GS_HD Lanes<float> scale_by_power_of_two(const Lanes<float>& x, const Lanes<float>& n) {
    using Types = LaneTypes<float>;
    return Lanes<float>::of([&](int k) {
        const Types::Bits exponent = (__builtin_convertvector(n.parts[k], Types::Bits) + 127) << 23;
        return x.parts[k] * (Types::Part)exponent;
    });
}
GS_HD float sum_lanes(const Lanes<float>& x) {
    Lanes<float>::Part sum = x.parts[0];
    for (int k = 1; k < kParts<float>; ++k) sum += x.parts[k];
    float s[kPartLanes<float>];
    __builtin_memcpy(s, &sum, sizeof s);
    for (int n = kPartLanes<float> / 2; n; n /= 2)
        for (int i = 0; i < n; ++i) s[i] += s[i + n];
    return s[0];
}

#endif

/// Returns 2^x with relative error below 2e-7 for x in [-1/2, 1/2] (coefficients: Cephes exp2f).
GS_HD Lanes<float> exp2_polynomial(const Lanes<float>& x) {
    using L = Lanes<float>;
    L p(1.535336188319500e-4f);
    p = gs_fma(p, x, L(1.339887440266574e-3f));
    p = gs_fma(p, x, L(9.618437357674640e-3f));
    p = gs_fma(p, x, L(5.550332471162809e-2f));
    p = gs_fma(p, x, L(2.402264791363012e-1f));
    p = gs_fma(p, x, L(6.931472028550421e-1f));
    return gs_fma(p, x, L(1.0f));
}

/// Returns 2^min(x,0) with relative error below 2e-7, and 0 below x = -126.
GS_HD Lanes<float> exp2_nonpositive(const Lanes<float>& x) {
    using L = Lanes<float>;
    const L clamped = lane_min(lane_max(x, L(-126.0f)), L(0.0f));
    const L n = round_lanes(clamped);
    return scale_by_power_of_two(exp2_polynomial(clamped - n), n);
}

// Double lanes serve the reference backend of the tests, so plain loops suffice.
inline Lanes<double> exp2_nonpositive(const Lanes<double>& x) {
    Lanes<double> r;
    for (int i = 0; i < kLanes; ++i) r.set(i, exp2_nonpositive(x[i]));
    return r;
}
inline double sum_lanes(const Lanes<double>& x) {
    double s = 0;
    for (int i = 0; i < kLanes; ++i) s += x[i];
    return s;
}

// --- the scalar functions of portable.h for lanes -----------------------------------------------------------------
// For NaN these return the same as the scalar versions.
template <class T> GS_HD Lanes<T> gs_min(const Lanes<T>& a, const Lanes<T>& b) { return lane_min(a, b); }
template <class T> GS_HD Lanes<T> gs_max(const Lanes<T>& a, const Lanes<T>& b) { return lane_max(a, b); }

/// Returns fn of each lane. Compilers vectorise functions for which the machine has instructions.
template <class T, class Fn> GS_HD Lanes<T> map_lanes(const Lanes<T>& x, Fn fn) {
    T v[kLanes];
    x.store(v);
    for (T& y : v) y = fn(y);
    return Lanes<T>::load(v);
}
template <class T> GS_HD Lanes<T> gs_sqrt(const Lanes<T>& x) {
    return map_lanes(x, [](T y) { return gs_sqrt(y); });
}
template <class T> GS_HD Lanes<T> gs_floor(const Lanes<T>& x) {
    return map_lanes(x, [](T y) { return gs_floor(y); });
}
template <class T> GS_HD Lanes<T> gs_ceil(const Lanes<T>& x) {
    return map_lanes(x, [](T y) { return gs_ceil(y); });
}
inline Lanes<double> gs_exp(const Lanes<double>& x) {
    return map_lanes(x, [](double y) { return gs_exp(y); });
}
inline Lanes<double> gs_log(const Lanes<double>& x) {
    return map_lanes(x, [](double y) { return gs_log(y); });
}

/// Returns e^x with relative error below 2e-7 for x in [-87, 88]. Outside, it returns the value at the nearer end.
GS_HD Lanes<float> gs_exp(const Lanes<float>& x) {
    using L = Lanes<float>;
    const L clamped = lane_min(L(88.0f), lane_max(L(-87.0f), x));  // in this order NaN stays NaN
    // x = n ln 2 + r. The first part of ln 2 is so short that its product with n is exact, also without FMA.
    const L log2e(1.44269504f), n = round_lanes(clamped * log2e);
    const L r = gs_fma(n, L(2.12194440e-4f), gs_fma(n, L(-0.693359375f), clamped));
    return scale_by_power_of_two(exp2_polynomial(r * log2e), n);
}

/// Returns ln x with error below 2e-7 (1 + |ln x|) for normal x > 0. For other x the result is unspecified.
GS_HD Lanes<float> gs_log(const Lanes<float>& x) {
    using L = Lanes<float>;
    using Types = LaneTypes<float>;
    // x = m 2^n with m in [sqrt(1/2), sqrt(2)), and ln m = 2 atanh(s) = 2 (s + s^3/3 + s^5/5 + ...).
    constexpr std::int32_t kSqrtHalf = 0x3f3504f3;
    L m, n;
    for (int k = 0; k < kParts<float>; ++k) {
        const Types::Bits bits = (Types::Bits)x.parts[k], exponent = (bits - kSqrtHalf) >> 23;
        m.parts[k] = (Types::Part)(bits - (exponent << 23));
        n.parts[k] = __builtin_convertvector(exponent, Types::Part);
    }
    const L one(1.0f), s = (m - one) / (m + one), s2 = s * s;
    const L series = gs_fma(gs_fma(gs_fma(L(2.0f / 7), s2, L(2.0f / 5)), s2, L(2.0f / 3)), s2, L(2.0f));
    return gs_fma(n, L(0.693147181f), series * s);
}

#endif  // __CUDACC__

}  // namespace gs
