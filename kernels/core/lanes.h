// SPDX-License-Identifier: Apache-2.0
// Vectors of sixteen lanes, with which the CPU blends sixteen pixels at once.
//
// `Lanes<T>` is a compiler vector of 16 values. With AVX-512, the few operations that compilers turn into poor code
// (compare + select, exp2, reciprocal) use its instructions. Every operation has an overload for a plain scalar, so the
// same templates serve one pixel (tests, CUDA) and sixteen.
#pragma once

#include <cstdint>

#include "kernels/core/portable.h"

#if defined(__AVX512F__) && defined(__AVX512DQ__) && !defined(__CUDACC__)
#include <immintrin.h>
#define GS_AVX512 1
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

template <class T> struct LaneTypes;
template <> struct LaneTypes<float> {
    typedef float Vector __attribute__((vector_size(64)));
    typedef std::int32_t Bits __attribute__((vector_size(64)));
};
template <> struct LaneTypes<double> {
    typedef double Vector __attribute__((vector_size(128)));
    typedef std::int64_t Bits __attribute__((vector_size(128)));
};

template <class T> struct LaneMask {
#ifdef GS_AVX512
    std::uint16_t bits;
    GS_HD LaneMask operator&(LaneMask o) const { return {std::uint16_t(bits & o.bits)}; }
#else
    typename LaneTypes<T>::Bits bits;
    GS_HD LaneMask operator&(LaneMask o) const { return {bits & o.bits}; }
#endif
};

template <class T> struct Lanes {
    typename LaneTypes<T>::Vector v;

    Lanes() = default;
    GS_HD Lanes(typename LaneTypes<T>::Vector x) : v(x) {}
    GS_HD explicit Lanes(T x) { v = x - typename LaneTypes<T>::Vector{}; }
    static GS_HD Lanes load(const T* p) {
        Lanes r;
        __builtin_memcpy(&r.v, p, sizeof r.v);
        return r;
    }
    GS_HD void store(T* p) const { __builtin_memcpy(p, &v, sizeof v); }
    GS_HD Lanes operator+(Lanes o) const { return v + o.v; }
    GS_HD Lanes operator-(Lanes o) const { return v - o.v; }
    GS_HD Lanes operator*(Lanes o) const { return v * o.v; }
    GS_HD Lanes operator-() const { return -v; }
};

// --- sixteen lanes ------------------------------------------------------------------------------------------------
#ifdef GS_AVX512

// The maskz forms compile to the plain instructions; the plain intrinsics read an uninitialized operand inside GCC's
// header, which GCC 12 warns about (GCC bug 105593).
inline constexpr __mmask16 kAllLanes = 0xffff;

GS_HD LaneMask<float> at_least(Lanes<float> a, Lanes<float> b) {
    return {_mm512_cmp_ps_mask((__m512)a.v, (__m512)b.v, _CMP_GE_OQ)};
}
GS_HD LaneMask<double> at_least(Lanes<double> a, Lanes<double> b) {
    typedef double Half __attribute__((vector_size(64)));
    Half ah[2], bh[2];
    __builtin_memcpy(ah, &a.v, sizeof ah);
    __builtin_memcpy(bh, &b.v, sizeof bh);
    const unsigned lo = _mm512_cmp_pd_mask((__m512d)ah[0], (__m512d)bh[0], _CMP_GE_OQ);
    const unsigned hi = _mm512_cmp_pd_mask((__m512d)ah[1], (__m512d)bh[1], _CMP_GE_OQ);
    return {std::uint16_t(lo | hi << 8)};
}
GS_HD Lanes<float> select(LaneMask<float> m, Lanes<float> a, Lanes<float> b) {
    return Lanes<float>((LaneTypes<float>::Vector)_mm512_mask_blend_ps(m.bits, (__m512)b.v, (__m512)a.v));
}
GS_HD Lanes<double> select(LaneMask<double> m, Lanes<double> a, Lanes<double> b) {
    Lanes<double> r;
    for (int i = 0; i < kLanes; ++i) r.v[i] = m.bits >> i & 1 ? a.v[i] : b.v[i];
    return r;
}
template <class T> GS_HD unsigned mask_bits(LaneMask<T> m) { return m.bits; }
GS_HD Lanes<float> gs_fma(Lanes<float> a, Lanes<float> b, Lanes<float> c) {
    return Lanes<float>((LaneTypes<float>::Vector)_mm512_fmadd_ps((__m512)a.v, (__m512)b.v, (__m512)c.v));
}
GS_HD Lanes<float> reciprocal(Lanes<float> x) {
    // One Newton step on the 14-bit estimate makes the relative error less than 2^-23.
    const __m512 r = _mm512_maskz_rcp14_ps(kAllLanes, (__m512)x.v);
    const __m512 e = _mm512_fnmadd_ps((__m512)x.v, r, _mm512_set1_ps(1.0f));
    return Lanes<float>((LaneTypes<float>::Vector)_mm512_fmadd_ps(r, e, r));
}
GS_HD Lanes<float> lane_max(Lanes<float> a, Lanes<float> b) {
    return Lanes<float>((LaneTypes<float>::Vector)_mm512_maskz_max_ps(kAllLanes, (__m512)a.v, (__m512)b.v));
}
GS_HD Lanes<float> lane_min(Lanes<float> a, Lanes<float> b) {
    return Lanes<float>((LaneTypes<float>::Vector)_mm512_maskz_min_ps(kAllLanes, (__m512)a.v, (__m512)b.v));
}
GS_HD Lanes<float> round_lanes(Lanes<float> x) {
    return Lanes<float>((LaneTypes<float>::Vector)_mm512_maskz_roundscale_ps(
        kAllLanes, (__m512)x.v, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC));
}
GS_HD Lanes<float> scale_by_power_of_two(Lanes<float> x, Lanes<float> n) {
    return Lanes<float>((LaneTypes<float>::Vector)_mm512_maskz_scalef_ps(kAllLanes, (__m512)x.v, (__m512)n.v));
}
GS_HD float sum_lanes(Lanes<float> x) {
    const __m256 a = _mm256_add_ps(_mm512_maskz_extractf32x8_ps(0xff, (__m512)x.v, 0),
                                   _mm512_maskz_extractf32x8_ps(0xff, (__m512)x.v, 1));
    const __m128 b = _mm_add_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
    const __m128 c = _mm_add_ps(b, _mm_movehl_ps(b, b));
    return _mm_cvtss_f32(_mm_add_ss(c, _mm_movehdup_ps(c)));
}

#else

template <class T> GS_HD LaneMask<T> at_least(Lanes<T> a, Lanes<T> b) { return {a.v >= b.v}; }
template <class T> GS_HD Lanes<T> select(LaneMask<T> m, Lanes<T> a, Lanes<T> b) { return Lanes<T>(m.bits ? a.v : b.v); }
template <class T> GS_HD unsigned mask_bits(LaneMask<T> m) {
    unsigned r = 0;
    for (int i = 0; i < kLanes; ++i) r |= unsigned(m.bits[i] & 1) << i;
    return r;
}
GS_HD Lanes<float> gs_fma(Lanes<float> a, Lanes<float> b, Lanes<float> c) { return a.v * b.v + c.v; }
GS_HD Lanes<float> reciprocal(Lanes<float> x) { return Lanes<float>(1.0f / x.v); }
GS_HD Lanes<float> lane_max(Lanes<float> a, Lanes<float> b) { return Lanes<float>(a.v > b.v ? a.v : b.v); }
GS_HD Lanes<float> lane_min(Lanes<float> a, Lanes<float> b) { return Lanes<float>(a.v < b.v ? a.v : b.v); }
GS_HD Lanes<float> round_lanes(Lanes<float> x) {
    // Adding 1.5*2^23 pushes the fraction out of the mantissa. This is exact for |x| < 2^22, which exp2's clamp
    // ensures.
    const LaneTypes<float>::Vector magic = 12582912.0f - LaneTypes<float>::Vector{};
    volatile LaneTypes<float>::Vector shifted = x.v + magic;
    return Lanes<float>(shifted - magic);
}
GS_HD Lanes<float> scale_by_power_of_two(Lanes<float> x, Lanes<float> n) {
    const LaneTypes<float>::Bits e = (__builtin_convertvector(n.v, LaneTypes<float>::Bits) + 127) << 23;
    return Lanes<float>(x.v * (LaneTypes<float>::Vector)e);
}
GS_HD float sum_lanes(Lanes<float> x) {
    float s[8];
    for (int i = 0; i < 8; ++i) s[i] = x.v[i] + x.v[i + 8];
    for (int n = 4; n; n /= 2)
        for (int i = 0; i < n; ++i) s[i] += s[i + n];
    return s[0];
}

#endif

/// Returns 2^min(x,0) with relative error below 2e-7, and 0 below x = -126. After the integer part is rounded off, a
/// polynomial serves on [-1/2,1/2] (coefficients: Cephes exp2f).
GS_HD Lanes<float> exp2_nonpositive(Lanes<float> x) {
    using L = Lanes<float>;
    const L clamped = lane_min(lane_max(x, L(-126.0f)), L(0.0f));
    const L n = round_lanes(clamped), f = clamped - n;
    L p(1.535336188319500e-4f);
    p = gs_fma(p, f, L(1.339887440266574e-3f));
    p = gs_fma(p, f, L(9.618437357674640e-3f));
    p = gs_fma(p, f, L(5.550332471162809e-2f));
    p = gs_fma(p, f, L(2.402264791363012e-1f));
    p = gs_fma(p, f, L(6.931472028550421e-1f));
    p = gs_fma(p, f, L(1.0f));
    return scale_by_power_of_two(p, n);
}

// Double lanes serve the reference backend of the tests, so plain loops are enough.
GS_HD Lanes<double> gs_fma(Lanes<double> a, Lanes<double> b, Lanes<double> c) { return a.v * b.v + c.v; }
GS_HD Lanes<double> reciprocal(Lanes<double> x) { return Lanes<double>(1.0 / x.v); }
GS_HD Lanes<double> lane_max(Lanes<double> a, Lanes<double> b) { return Lanes<double>(a.v > b.v ? a.v : b.v); }
GS_HD Lanes<double> lane_min(Lanes<double> a, Lanes<double> b) { return Lanes<double>(a.v < b.v ? a.v : b.v); }
inline Lanes<double> exp2_nonpositive(Lanes<double> x) {
    Lanes<double> r;
    for (int i = 0; i < kLanes; ++i) r.v[i] = exp2_nonpositive(double(x.v[i]));
    return r;
}
inline double sum_lanes(Lanes<double> x) {
    double s = 0;
    for (int i = 0; i < kLanes; ++i) s += x.v[i];
    return s;
}

#endif  // __CUDACC__

}  // namespace gs
