// SPDX-License-Identifier: Apache-2.0
// The small vectors and matrices of the rendering mathematics, as templates over the scalar (or lane vector).
#pragma once

#include "kernels/base/portable.h"

namespace gs {

template <class T> struct Vec2 {
    T x, y;

    GS_HD Vec2 operator+(const Vec2& o) const { return {x + o.x, y + o.y}; }
    GS_HD Vec2 operator-(const Vec2& o) const { return {x - o.x, y - o.y}; }
    GS_HD Vec2 operator*(T s) const { return {x * s, y * s}; }
};

template <class T> struct Vec3 {
    T x, y, z;
    GS_HD Vec3 operator+(const Vec3& o) const { return {x + o.x, y + o.y, z + o.z}; }
    GS_HD Vec3 operator-(const Vec3& o) const { return {x - o.x, y - o.y, z - o.z}; }
    GS_HD Vec3 operator*(T s) const { return {x * s, y * s, z * s}; }
    GS_HD Vec3 operator*(const Vec3& o) const { return {x * o.x, y * o.y, z * o.z}; }
    GS_HD Vec3& operator+=(const Vec3& o) {
        x = x + o.x;
        y = y + o.y;
        z = z + o.z;
        return *this;
    }
};
template <class T> GS_HD T dot(const Vec3<T>& a, const Vec3<T>& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <class T> GS_HD Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <class T> struct Vec4 { T x, y, z, w; };

/// A symmetric 2x2 matrix [[xx,xy],[xy,yy]]. In a gradient, xy is ONE off-diagonal element of the gradient matrix,
/// which is half the derivative with respect to the shared scalar (docs/math/rasterizer.md#conventions).
template <class T> struct Sym2 { T xx, xy, yy; };

/// A symmetric 3x3 matrix, with the same half convention for gradients.
template <class T> struct Sym3 {
    T xx, xy, xz, yy, yz, zz;
    GS_HD Vec3<T> operator*(const Vec3<T>& v) const {
        return {xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z, xz * v.x + yz * v.y + zz * v.z};
    }
};

/// A 3x3 matrix with rows r0..r2.
template <class T> struct Mat3 {
    Vec3<T> r0, r1, r2;
    GS_HD Vec3<T> operator*(const Vec3<T>& v) const { return {dot(r0, v), dot(r1, v), dot(r2, v)}; }
    GS_HD Vec3<T> transposed_times(const Vec3<T>& v) const { return r0 * v.x + r1 * v.y + r2 * v.z; }
};

}  // namespace gs
