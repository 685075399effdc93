// SPDX-License-Identifier: Apache-2.0
// Numbers with their derivatives by two variables, for functions whose Jacobian is needed at one point.
#pragma once

#include "kernels/base/portable.h"

namespace gs {

/// A value with its derivatives by two variables up to the second order. A caller that reads no second derivatives
/// does not pay for them: the compiler removes what is not read.
template <class T> struct Jet {
    T value, x, y, xx, xy, yy;

    /// Returns value + a x + b y.
    static GS_HD Jet linear(T value, T a, T b) { return {value, a, b, T(0), T(0), T(0)}; }

    /// Returns f of this number; f0, f1 and f2 are f(value), f'(value) and f''(value).
    GS_HD Jet chain(T f0, T f1, T f2) const {
        return {f0, f1 * x, f1 * y, f2 * x * x + f1 * xx, f2 * x * y + f1 * xy, f2 * y * y + f1 * yy};
    }
};

template <class T> GS_HD Jet<T> operator+(const Jet<T>& a, const Jet<T>& b) {
    return {a.value + b.value, a.x + b.x, a.y + b.y, a.xx + b.xx, a.xy + b.xy, a.yy + b.yy};
}
template <class T> GS_HD Jet<T> operator-(const Jet<T>& a, const Jet<T>& b) {
    return {a.value - b.value, a.x - b.x, a.y - b.y, a.xx - b.xx, a.xy - b.xy, a.yy - b.yy};
}
template <class T> GS_HD Jet<T> operator*(const Jet<T>& a, const Jet<T>& b) {
    return {a.value * b.value,
            a.x * b.value + a.value * b.x,
            a.y * b.value + a.value * b.y,
            a.xx * b.value + T(2) * (a.x * b.x) + a.value * b.xx,
            a.xy * b.value + a.x * b.y + a.y * b.x + a.value * b.xy,
            a.yy * b.value + T(2) * (a.y * b.y) + a.value * b.yy};
}
template <class T> GS_HD Jet<T> operator*(const Jet<T>& a, T k) {
    return {a.value * k, a.x * k, a.y * k, a.xx * k, a.xy * k, a.yy * k};
}
template <class T> GS_HD Jet<T> operator+(const Jet<T>& a, T k) { return {a.value + k, a.x, a.y, a.xx, a.xy, a.yy}; }

template <class T> GS_HD T gs_inverse(T a) { return T(1) / a; }
template <class T> GS_HD Jet<T> gs_inverse(const Jet<T>& a) {
    const T r = T(1) / a.value, r2 = r * r;
    return a.chain(r, -r2, T(2) * r2 * r);
}
template <class T> GS_HD Jet<T> gs_sqrt(const Jet<T>& a) {
    const T root = gs_sqrt(a.value), slope = T(0.5) / root;
    return a.chain(root, slope, -(slope / (T(2) * a.value)));
}
/// Returns the angle of (x, y) to the x axis. The point must not be the origin.
template <class T> GS_HD Jet<T> gs_atan2(const Jet<T>& y, const Jet<T>& x) {
    // The angle of the point by which (x, y) is turned onto the x axis has the same derivatives.
    const T k = T(1) / (x.value * x.value + y.value * y.value), c = k * x.value, s = k * y.value;
    const Jet<T> turned_x = x * c + y * s, turned_y = y * c - x * s;
    const Jet<T> t = turned_y * gs_inverse(turned_x);  // tan of an angle of 0: atan has slope 1 and no curvature
    return {gs_atan2(y.value, x.value), t.x, t.y, t.xx, t.xy, t.yy};
}

/// The value of a number, with or without derivatives.
template <class T> GS_HD T value_of(const Jet<T>& a) { return a.value; }
template <class T> GS_HD T value_of(T a) { return a; }

}  // namespace gs
