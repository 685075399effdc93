// SPDX-License-Identifier: Apache-2.0
// Macros and scalar functions with the same meaning on host and device.
#pragma once

#include <cmath>
#include <cstdint>

#if defined(__CUDACC__)
#define GS_HD __host__ __device__ __forceinline__
/// Keeps a function that few calls need out of the registers of the others.
#define GS_NOINLINE inline __host__ __device__ __noinline__
/// Unrolls the next loop on the device, so that the elements of an array stay in registers. The bound must be constant.
#define GS_UNROLL _Pragma("unroll")
#else
#define GS_HD inline __attribute__((always_inline))
#define GS_NOINLINE inline
#define GS_UNROLL
#endif

namespace gs {

template <class T> GS_HD T gs_min(T a, T b) { return a < b ? a : b; }
template <class T> GS_HD T gs_max(T a, T b) { return a > b ? a : b; }
template <class T> GS_HD T gs_clamp(T x, T lo, T hi) { return gs_min(gs_max(x, lo), hi); }

// These overloads replace std:: calls, so that the same template text compiles for float, double and device code.
GS_HD float gs_exp(float x) { return ::expf(x); }
GS_HD double gs_exp(double x) { return ::exp(x); }
GS_HD float gs_log(float x) { return ::logf(x); }
GS_HD double gs_log(double x) { return ::log(x); }
GS_HD float gs_exp2(float x) { return ::exp2f(x); }
GS_HD double gs_exp2(double x) { return ::exp2(x); }
GS_HD float gs_pow(float x, float y) { return ::powf(x, y); }
GS_HD double gs_pow(double x, double y) { return ::pow(x, y); }
GS_HD float gs_sqrt(float x) { return ::sqrtf(x); }
GS_HD double gs_sqrt(double x) { return ::sqrt(x); }
GS_HD float gs_expm1(float x) { return ::expm1f(x); }
GS_HD double gs_expm1(double x) { return ::expm1(x); }
GS_HD float gs_log1p(float x) { return ::log1pf(x); }
GS_HD double gs_log1p(double x) { return ::log1p(x); }
GS_HD float gs_abs(float x) { return ::fabsf(x); }
GS_HD double gs_abs(double x) { return ::fabs(x); }
GS_HD float gs_tanh(float x) { return ::tanhf(x); }
GS_HD double gs_tanh(double x) { return ::tanh(x); }
GS_HD float gs_sin(float x) { return ::sinf(x); }
GS_HD double gs_sin(double x) { return ::sin(x); }
GS_HD float gs_cos(float x) { return ::cosf(x); }
GS_HD double gs_cos(double x) { return ::cos(x); }
GS_HD void gs_sincos(float x, float& s, float& c) { ::sincosf(x, &s, &c); }
GS_HD void gs_sincos(double x, double& s, double& c) { ::sincos(x, &s, &c); }
GS_HD float gs_fma(float a, float b, float c) { return ::fmaf(a, b, c); }
GS_HD double gs_fma(double a, double b, double c) { return ::fma(a, b, c); }
GS_HD float gs_atan2(float y, float x) { return ::atan2f(y, x); }
GS_HD double gs_atan2(double y, double x) { return ::atan2(y, x); }
GS_HD float gs_floor(float x) { return ::floorf(x); }
GS_HD double gs_floor(double x) { return ::floor(x); }
GS_HD float gs_ceil(float x) { return ::ceilf(x); }
GS_HD double gs_ceil(double x) { return ::ceil(x); }
#if !defined(__CUDACC__)
// Long double is the reference of the stability measurements (eval/bench/stability.h). nvcc would treat it as double.
inline long double gs_exp(long double x) { return ::expl(x); }
inline long double gs_log(long double x) { return ::logl(x); }
inline long double gs_sqrt(long double x) { return ::sqrtl(x); }
inline long double gs_expm1(long double x) { return ::expm1l(x); }
inline long double gs_log1p(long double x) { return ::log1pl(x); }
inline long double gs_abs(long double x) { return ::fabsl(x); }
inline long double gs_tanh(long double x) { return ::tanhl(x); }
inline long double gs_sin(long double x) { return ::sinl(x); }
inline long double gs_cos(long double x) { return ::cosl(x); }
inline long double gs_atan2(long double y, long double x) { return ::atan2l(y, x); }
inline void gs_sincos(long double x, long double& s, long double& c) { s = ::sinl(x), c = ::cosl(x); }
// fmal would be a hundred times slower.
inline long double gs_fma(long double a, long double b, long double c) { return a * b + c; }
#endif
template <class T> GS_HD bool gs_isfinite(T x) {
    return gs_abs(x) <= (sizeof(T) == 4 ? T(3.402823466e38) : T(1.7976931348623157e308));
}

/// The logistic function, stable for every finite x.
template <class T> GS_HD T sigmoid(T x) { return T(1) / (T(1) + gs_exp(-x)); }

/// Returns ln(1 + e^x), stable for every finite x. Its derivative is the logistic function.
template <class T> GS_HD T softplus(T x) { return gs_max(x, T(0)) + gs_log1p(gs_exp(-gs_abs(x))); }

/// The derivative of tanh. In float, 1 - tanh^2 would be exactly 0 from |x| = 9 on; this form is positive up to 43.
template <class T> GS_HD T tanh_derivative(T x) {
    const T e = gs_exp(T(-2) * gs_abs(x));
    return T(4) * e / ((T(1) + e) * (T(1) + e));
}

}  // namespace gs
